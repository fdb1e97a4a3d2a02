"""Files described in a few words, and the texts that hold them."""

from pathlib import Path

import pytest
from brdf_files import RglFile

from addon import facts

SAMPLE = Path(__file__).resolve().parents[2] / "samples" / "wool_W64xH64_L81xV81.btf"


@pytest.mark.parametrize(
    ("size", "text"),
    [
        (1, "0 kB"),
        (333_203, "333 kB"),
        (1_217_000, "1.22 MB"),
        (16_500_000, "16.5 MB"),
        (161_243_136, "161 MB"),
        (2_414_000_000, "2.41 GB"),
    ],
)
def test_sizes_have_three_digits(size, text):
    assert facts.size_text(size) == text


def test_a_measured_file_before_its_import():
    assert facts.parse_facts(facts.source_facts(str(SAMPLE))) == [
        ("Directions", "81 lights × 81 views"),
        ("Texels", "64 × 64"),
        ("File", "6.20 MB"),
        ("On Disk", "161 MB"),
        ("Memory", "about 146 MB"),
    ]


def test_a_file_is_looked_at_once_until_it_changes(tmp_path, monkeypatch):
    calls = []
    describe = facts.describe_source
    monkeypatch.setattr(
        facts, "describe_source", lambda *a, **k: calls.append(a) or describe(*a, **k)
    )
    path = tmp_path / "wool.btf"
    path.write_bytes(SAMPLE.read_bytes())
    good = facts.source_facts(str(path))
    assert facts.source_facts(str(path)) == good
    assert len(calls) == 1
    path.write_bytes(SAMPLE.read_bytes()[:1000])
    (problem,) = facts.parse_facts(facts.source_facts(str(path)))
    assert problem[0] == ""
    assert "wool.btf" in problem[1]
    assert len(calls) == 2


def test_what_a_format_takes(tmp_path):
    assert "cosine" in facts.source_takes(str(SAMPLE))
    assert "lights" not in facts.source_takes(str(SAMPLE))
    path = tmp_path / "cloth.bsdf"
    path.write_bytes(b"no tensor file")
    assert facts.source_takes(str(path)) >= {"lights", "views", "patch_width"}
    path.rename(tmp_path / "cloth.txt")
    assert facts.source_takes(str(tmp_path / "cloth.txt")) == frozenset()
    assert facts.source_takes(str(path)) == frozenset()


def test_facts_follow_the_options_and_the_list(tmp_path):
    path, listed = tmp_path / "a.bsdf", tmp_path / "a.csv"
    path.write_bytes(RglFile().to_bytes())
    rows = facts.parse_facts(facts.source_facts(str(path), lights="uniform:9"))
    assert rows[0] == ("Directions", "9 lights × 81 views")
    assert dict(rows)["On Disk"] == "9 kB"
    for count in (2, 3):
        listed.write_text("theta,phi\n" + "0,0\n" * count)
        rows = facts.parse_facts(facts.source_facts(str(path), directions=str(listed)))
        assert rows[0] == ("Directions", f"{count} lights × {count} views")


def test_no_file_has_no_facts(tmp_path):
    assert facts.source_facts(str(tmp_path / "absent.btf")) == ""
    assert facts.dataset_facts("") == facts.model_facts("") == ""
