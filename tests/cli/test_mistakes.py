"""A user's mistake: status 2, one line on standard error that says what was wrong, nothing left."""

import pytest

MISTAKES = [
    # the command line itself
    ("", "VERB"),
    ("fit small.nacre m.exr", "'fit'"),
    ("compress small.nacre", "model"),
    ("info small.nacre --verbose", "--verbose"),
    ("compress small.nacre m.exr --ranks light", "'light'", "view=4,y=32"),
    ("compress small.nacre m.exr --ranks light=x", "'light=x'"),
    ("compress small.nacre m.exr --seed -1", "'-1'"),
    ("compress small.nacre m.exr --threads two", "'two'"),
    ("decode kcta.exr d.nacre --light 3", "'3'", "3:7"),
    ("decode kcta.exr d.nacre --light 1:2:3", "3:7"),
    ("decode kcta.exr d.nacre --rows 1:2", "--rows"),
    ("import good.btf d.nacre --cosine 2", "2"),
    ("render kcta.exr p.png --light 100,0", "100"),
    ("render kcta.exr p.png --light 45", "45,90"),
    ("render kcta.exr p.png --view nan,0", "nan"),
    ("render kcta.exr p.png --light 45,inf", "inf"),
    ("render kcta.exr p.png --size 640", "640x480"),
    ("render kcta.exr p.png --size 0x9", "16384"),
    ("render kcta.exr p.png --samples 0", "'0'"),
    # files that are not there or not what is expected
    ("info absent", "absent"),
    ("info absent.exr", "absent.exr", "no such file"),
    ("info text.exr", "text.exr", "OpenEXR"),
    ("info some.csv", "some.csv"),
    ("info empty.nacre", "empty.nacre"),
    ("info " + "n" * 300, "n"),
    ("import absent.btf d.nacre", "absent.btf"),
    ("import some.csv d.nacre", "some.csv"),
    ("import good.btf d.nacre --format exr", "exr", "choose from btf, "),
    ("import good.btf absent/d.nacre", "absent"),
    ("import small.nacre d.nacre", "already"),
    ("export absent.nacre m.btf", "absent.nacre"),
    ("export kcta.exr m.btf", "kcta.exr"),
    ("export small.nacre m.exr", "m.exr", ".btf or .zip"),
    ("export small.nacre m.btf --format merl", "'merl'"),
    ("export small.nacre m.btf --components 0", "'0'"),
    ("export small.nacre m.zip --components 3", "--components"),
    ("export small.nacre absent/m.btf", "absent"),
    ("export small.nacre absent/m.zip", "absent"),
    ("export cut.nacre m.btf", "cut.nacre"),
    ("compress absent.nacre m.exr", "absent.nacre"),
    ("compress kcta.exr m.exr", "kcta.exr"),
    ("compress small.nacre m.png", "m.png", ".exr"),
    ("compress small.nacre absent/m.exr", "absent"),
    ("decode small.nacre d.nacre", "small.nacre"),
    ("decode absent.exr d.nacre", "absent.exr"),
    ("decode a.png d.nacre", "a.png"),
    ("decode kcta.exr absent/d.nacre", "absent"),
    ("decode kcta.exr a.png", "a.png"),
    ("decode kcta.exr d.nacre --directions absent.csv", "absent.csv"),
    ("decode kcta.exr d.nacre --directions below.csv", "line 3", "below"),
    ("decode kcta.exr d.nacre --directions angles.csv", "theta,phi"),
    ("compare small.nacre absent", "absent"),
    ("compare some.csv small.nacre", "some.csv"),
    ("compare small.nacre other.nacre", "(6, 7, 8, 10, 3)", "(6, 7, 8, 9, 3)"),
    ("compare a.png tiny.png", "(6, 5, 3)", "(4, 4, 3)"),
    ("compare a.png small.nacre", "shape"),
    # damaged files
    ("info cut.btf", "cut.btf"),
    ("import cut.btf d.nacre", "cut.btf"),
    ("info cut.zip", "cut.zip"),
    ("import cut.zip d.nacre", "cut.zip"),
    ("info cut.exr", "cut.exr", "damaged"),
    ("decode cut.exr d.nacre", "cut.exr", "damaged"),
    ("compare small.nacre cut.exr", "cut.exr", "damaged"),
    ("info cut.nacre", "cut.nacre", "cut short"),
    ("compress cut.nacre m.exr", "cut.nacre", "cut short"),
    ("compare a.png cut.png", "cut.png"),
    # settings that do not fit the dataset
    ("compress small.nacre m.exr --method svd", "'svd'", "nsvd, cta, kcta"),
    ("compress small.nacre m.exr --quality best", "'best'", "draft, medium or high"),
    ("compress small.nacre m.exr --domain lab", "'lab'", "linear, log"),
    ("compress small.nacre m.exr --domain log --target-db 5", "--domain", "linear"),
    ("compress small.nacre m.exr --ranks light=19", "light=19", "18 rows"),
    ("compress small.nacre m.exr --ranks z=1", "'z'", "light, view, y, x"),
    ("compress small.nacre m.exr --clusters view=8", "view=8", "the 7 of"),
    ("compress small.nacre m.exr --clusters view=2 --mixtures view=3", "view=3", "view=2"),
    ("compress small.nacre m.exr --method nsvd --clusters view=2", "nsvd has no clusters"),
    ("compress small.nacre m.exr --clusters light=2,view=2", "kcta clusters one mode"),
    ("compress small.nacre m.exr --method cta --mixtures view=2", "cta"),
    ("compress small.nacre m.exr --global view", "'view'"),
    # ranges that leave nothing
    ("decode kcta.exr d.nacre --light 6:", "--light"),
    ("decode kcta.exr d.nacre --x 4:4", "--x"),
    ("decode kcta.exr d.nacre --y 5:2", "--y"),
    ("decode kcta.exr d.nacre --directions some.csv --view 4:9", "--view"),
]


@pytest.mark.parametrize("command", MISTAKES, ids=lambda command: command[0][:60])
def test_one_line_says_what_was_wrong(command, nacre, listing):
    text, *words = command
    before = listing()
    for arguments in (text.split(), [*text.split(), "--json"] if text else []):
        said = nacre(*arguments, status=2)
        for word in words:
            assert word in said
    assert listing() == before


def test_help_is_no_mistake(nacre, capfd):
    for arguments in (["--help"], ["compress", "--help"]):
        with pytest.raises(SystemExit) as stop:
            nacre(*arguments)
        assert stop.value.code == 0
        out, err = capfd.readouterr()
        assert out.startswith("usage: nacre")
        assert err == ""
