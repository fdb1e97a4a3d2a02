"""Fuzz one reader, guided by coverage: python -m tests.fuzz NAME [--seconds N] [--merge].

What is found is kept under build/fuzz/NAME; --merge copies what reaches new code from there to the
corpus in the tests instead of fuzzing. Needs atheris (requirements/fuzz.txt).
"""

import argparse
import sys
import tempfile
from pathlib import Path

import atheris

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    with atheris.instrument_imports(include=["addon"]):
        from tests.fuzz import harness
    parser = argparse.ArgumentParser(prog="tests.fuzz", description=__doc__)
    parser.add_argument("name", choices=harness.TARGETS)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--merge", action="store_true")
    options = parser.parse_args()
    module = harness.target(options.name)

    corpus, work = harness.CORPUS / options.name, ROOT / "build" / "fuzz" / options.name
    for folder in (corpus, work):
        folder.mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = str(work.parent)  # libFuzzer ends the process without tidying up
    seeds = module.seeds()
    for label, data in seeds.items():
        (work / f"seed-{label}").write_bytes(data)
    longest = 2 * max(map(len, seeds.values()))
    limits = ["-timeout=10", "-rss_limit_mb=1024", f"-max_len={longest}"]
    if options.merge:
        arguments = ["-merge=1", str(corpus), str(work)]
    else:
        arguments = [
            f"-max_total_time={options.seconds}",
            f"-artifact_prefix={work.parent}/{options.name}-",
            "-print_final_stats=1",
            str(work),
            str(corpus),
        ]

    def test_one(data: bytes) -> None:
        harness.read(module, data)

    atheris.Setup([sys.argv[0], *limits, *arguments], test_one)
    atheris.Fuzz()


main()
