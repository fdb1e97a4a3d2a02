"""The command line: `blender --command nacre VERB ...` and `python -m addon VERB ...`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from typing import Any, NoReturn

from .errors import NacreError
from .verbs import VERBS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; 0 when it succeeded, 2 and one line on standard error when the user erred."""
    try:
        options = _parser().parse_args(arguments)
        with Progress() as progress:
            result = options.run(options, progress)
    except (NacreError, OSError) as error:
        return _fail(2, str(error))
    except MemoryError:
        return _fail(2, "not enough memory: close other programs or take a smaller dataset")
    except KeyboardInterrupt:
        return _fail(130, "cancelled")
    if options.json:
        print(json.dumps(result, allow_nan=False))
    else:
        print("\n".join(_lines(result)))
    return 0


def _fail(status: int, message: str) -> int:
    print(f"nacre: {' '.join(message.splitlines())}", file=sys.stderr)
    return status


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise NacreError(f"{message} (`{self.prog} --help` explains)")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="nacre", description=__doc__)
    verbs = parser.add_subparsers(required=True, metavar="VERB", parser_class=_Parser)
    for name, verb in VERBS.items():
        text = verb.__doc__
        sub = verbs.add_parser(name, help=text, description=text)
        sub.add_argument("--json", action="store_true", help="print one JSON object")
        sub.set_defaults(run=verb.run)
        verb.add_arguments(sub)
    return parser


def _lines(result: dict[str, Any], indent: str = "") -> list[str]:
    """A result for people: one line a value, nested ones indented."""
    lines = []
    for key, value in result.items():
        if isinstance(value, dict):
            lines += [f"{indent}{key}", *_lines(value, indent + "  ")]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            lines += [f"{indent}{key}", *(f"{indent}  {json.dumps(item)}" for item in value)]
        else:
            lines.append(f"{indent}{key:<16} {value}")
    return lines


class Progress:
    """A progress callback that writes one changing line to a terminal, with the time left."""

    def __init__(self) -> None:
        self.started = time.monotonic()
        self.shown = False

    def __call__(self, fraction: float, message: str) -> bool:
        if sys.stderr.isatty():
            left = (time.monotonic() - self.started) * (1.0 - fraction) / max(fraction, 1e-3)
            rest = f"{left:4.0f} s left" if fraction > 0.02 else ""
            print(f"\r{message:<40.40} {fraction:4.0%} {rest:<12}", end="", file=sys.stderr)
            self.shown = True
        return True

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self.shown:
            print(f"\r{'':<64}\r", end="", file=sys.stderr, flush=True)
