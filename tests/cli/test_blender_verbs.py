"""The mistakes one can make with the verbs that render; what they render is tested elsewhere."""

import sys

import pytest

MISTAKES = [
    ("render kcta.exr p.png --engine workbench", "'workbench'", "eevee, cycles"),
    ("render kcta.exr p.jpg", "p.jpg", ".exr or .png"),
    ("render kcta.exr absent/p.png", "absent"),
    ("render absent.exr p.png", "absent.exr", "no such file"),
    ("render cut.exr p.png", "cut.exr", "damaged"),
    ("render kcta.exr p.png --mesh cube", "'cube'", "sphere"),
    ("render kcta.exr p.png --mesh absent.obj", "absent.obj"),
    ("render kcta.exr p.png --mesh some.csv", "some.csv", ".obj"),
    ("material kcta.exr m.exr", "m.exr", ".blend"),
    ("material absent.exr m.blend", "absent.exr"),
    ("material kcta.exr absent/m.blend", "absent"),
    ("verify absent.exr", "absent.exr"),
    ("render log.exr p.png", "log domain", "--domain linear"),
    ("material log.exr m.blend", "log domain", "--domain linear"),
    ("verify log.exr", "log domain", "--domain linear"),
    ("verify kcta.exr --engine workbench", "'workbench'", "eevee, cycles"),
]


@pytest.mark.parametrize("command", MISTAKES, ids=lambda command: command[0])
def test_one_line_says_what_was_wrong(command, nacre, listing):
    pytest.importorskip("bpy")
    text, *words = command
    before = listing()
    said = nacre(*text.split(), status=2)
    for word in words:
        assert word in said
    assert listing() == before


@pytest.mark.parametrize(
    "command", ["render kcta.exr p.png", "material kcta.exr m.blend", "verify kcta.exr"]
)
def test_without_blender_they_say_how_to_run_them(command, nacre, monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)
    assert "blender --command nacre" in nacre(*command.split(), status=2)


def test_the_other_verbs_do_without_blender(nacre, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "bpy", None)
    for command in (
        "import good.btf OUT/d.nacre",
        "info kcta.exr",
        "compress small.nacre OUT/m.exr",
        "decode kcta.exr OUT/e.nacre --directions some.csv",
        "compare small.nacre kcta.exr",
    ):
        assert nacre(*command.replace("OUT", str(tmp_path)).split())
