"""The verbs of sparse codes: train, compress --method sparse, info, decode, compare, blend."""

import json
import re

import numpy as np
import pytest
from PIL import Image
from small_btf import make_samples, write_dataset

from addon.cli import main
from addon.datasets.dataset import open_dataset
from addon.models.any_model import load_any
from addon.models.checkpoint import StateFile
from addon.models.sparse import coding

SHAPE = (6, 7, 8, 10, 3)
SMALL = ["--patch", "4", "--dictionaries", "2", "--sweeps", "3", "--sparsity", "y=40,uv=8"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sparse")
    for name in ("a", "b"):
        write_dataset(folder / f"{name}.nacre", SHAPE)
    write_dataset(folder / "more.nacre", (6, 8, 8, 10, 3))
    write_dataset(folder / "c.nacre", SHAPE, make_samples(SHAPE, seed=3))
    names = [str(folder / name) for name in ("a.nacre", "b.nacre", "e.exr")]
    assert main(["train", *names, *SMALL]) == 0
    sparse = ["--method", "sparse", "--ensemble", names[2]]
    assert main(["compress", names[0], str(folder / "m.exr"), *sparse]) == 0
    assert main(["compress", str(folder / "c.nacre"), str(folder / "c.exr"), *sparse]) == 0
    half = np.zeros(SHAPE[2:4], np.uint8)
    half[:2] = 255  # pictures have their first row on top
    Image.fromarray(half).save(folder / "mask.png")
    Image.fromarray(half.T).save(folder / "tall.png")
    return folder


@pytest.fixture
def run(folder, capsys):
    def call(*arguments):
        """Status, the JSON printed, and the line on standard error."""
        is_file = re.compile(r"[a-z].*\.[a-z]+").fullmatch
        names = [str(folder / a) if is_file(a) else a for a in arguments]
        status = main([*names, "--json"])
        printed = capsys.readouterr()
        result = json.loads(printed.out.splitlines()[-1]) if printed.out else None
        return status, result, printed.err.strip()

    return call


def test_info_of_an_ensemble_and_a_model(run):
    _, ensemble, _ = run("info", "e.exr")
    assert ensemble["what"] == "ensemble" and ensemble["patch"] == [4, 4]
    assert ensemble["dictionaries"] == {"Y": 2, "U": 2, "V": 2}
    assert ensemble["materials"] == ["a", "b"]
    _, model, _ = run("info", "m.exr")
    assert model["method"] == "sparse" and model["quality"] == 64
    assert model["shape"] == list(SHAPE) and "note" not in model
    assert model["code_bytes"] <= 2 * 64 * 8 * 12


def test_decode_at_qualities_and_directions(run, folder):
    _, model, _ = run("info", "m.exr")
    found = []
    for quality in ("4", "16", "64"):
        assert run("decode", "m.exr", "d.nacre", "--quality", quality)[0] == 0
        found.append(run("compare", "a.nacre", "d.nacre")[1]["snr_db"])
    assert found == sorted(found)
    assert found[-1] == pytest.approx(model["snr_db"], abs=0.1)
    assert run("compare", "a.nacre", "m.exr")[1]["snr_db"] == pytest.approx(found[-1], abs=0.01)
    assert run("decode", "m.exr", "d.nacre", "--light", "1:3", "--y", "2:7")[0] == 0
    assert open_dataset(folder / "d.nacre").shape == (2, 7, 5, 10, 3)
    (folder / "some.csv").write_text("theta,phi\n0,0\n30,45\n")
    for kernel in ("linear", "gaussian"):
        status, _, _ = run(
            "decode", "m.exr", "d.nacre", "--directions", "some.csv", "--kernel", kernel
        )
        assert status == 0
        assert open_dataset(folder / "d.nacre").shape == (2, 2, 8, 10, 3)
        assert np.isfinite(open_dataset(folder / "d.nacre").samples).all()
    images = ["--directions", "some.csv", "--interpolation", "image"]
    assert run("decode", "m.exr", "i.nacre", *images)[0] == 0
    assert run("decode", "m.exr", "d.nacre", *images[:2])[0] == 0
    assert 5 < run("compare", "i.nacre", "d.nacre")[1]["snr_db"] < 60  # near, and not the same


def test_a_cut_file_is_named_by_its_quality(run, folder):
    data = (folder / "m.exr").read_bytes()
    (folder / "cut.exr").write_bytes(data[: int(0.8 * len(data))])
    status, found, _ = run("info", "cut.exr")
    assert status == 0 and f"quality {found['quality']}" in found["note"]
    assert found["quality"] < 64 and "snr_db" not in found
    assert run("decode", "cut.exr", "d.nacre")[0] == 0
    (folder / "cut.exr").write_bytes(data[:2000])
    status, _, line = run("info", "cut.exr")
    assert status == 2 and "cut.exr" in line and "\n" not in line


def test_a_blend_is_a_model_between_both(run, folder):
    snr = {}
    for share in ("0", "0.5", "1"):
        status, found, _ = run("blend", "m.exr", "c.exr", "x.exr", "--mix", share)
        assert status == 0 and found["method"] == "sparse"
        snr[share] = [run("compare", own, "x.exr")[1]["snr_db"] for own in ("m.exr", "c.exr")]
    assert snr["0"][0] > 40 and snr["1"][1] > 40
    assert snr["0"][0] > snr["0.5"][0] > snr["1"][0] and snr["0"][1] < snr["0.5"][1] < snr["1"][1]
    assert found["weights"] == [0.0, 1.0]
    status, found, _ = run("blend", "m.exr", "c.exr", "x.exr", "--mix", "0.5", "--quality", "8")
    assert status == 0 and found["quality"] == 8 and found["snr_db"] < 30
    status, found, _ = run(
        "blend", "m.exr", "c.exr", "x.exr", "--mix", "0.5", "--sparsity", "y=30,uv=5"
    )
    assert status == 0 and found["sparsity"] == {"Y": 30, "U": 5, "V": 5}
    assert found["weights"] == [0.5, 0.5] and 0 < found["lost"] < 1


def test_a_blend_by_a_mask(run, folder):
    status, found, _ = run("blend", "m.exr", "c.exr", "x.exr", "--mask", "mask.png")
    assert status == 0 and found["weights"] == [0.75, 0.25]
    a, b, mixed = (load_any(folder / name).decode() for name in ("m.exr", "c.exr", "x.exr"))
    # White is on top: rows 6 and 7 are b's; more than half of the error is not there.
    for rows, own, other in ((slice(0, 6), a, b), (slice(6, 8), b, a)):
        near = ((mixed - own)[:, :, rows] ** 2).sum()
        assert near < 0.1 * ((mixed - other)[:, :, rows] ** 2).sum()
    status, found, _ = run("blend", "m.exr", "c.exr", "x.exr", "--mask", "mask.png", "--mix", "0.5")
    assert status == 0 and found["weights"] == [0.875, 0.125]


def test_interrupted_coding_goes_on(run, folder, monkeypatch):
    """As after a kill: the state is there, the model is not."""
    monkeypatch.setattr(coding, "BLOCK", 1)
    monkeypatch.setattr(StateFile, "due", True)

    def kill(*_):
        raise KeyboardInterrupt

    arguments = ["compress", "a.nacre", "y.exr", "--method", "sparse", "--ensemble", "e.exr"]
    with monkeypatch.context() as patch:
        patch.setattr(coding, "measure", kill)
        assert run(*arguments)[0] == 130
    assert (folder / ".y.exr.fit").exists() and not (folder / "y.exr").exists()
    status, _, line = run(*arguments, "--resume", "--sparsity", "y=9,uv=3")
    assert status == 2 and "other settings" in line
    status, found, _ = run(*arguments, "--resume", "--memory", "0.5")
    assert status == 0 and not (folder / ".y.exr.fit").exists()
    assert found["snr_db"] == run("info", "m.exr")[1]["snr_db"]


def test_the_fitting_ensemble_of_several_is_taken(run):
    assert run("train", "more.nacre", "e2.exr", *SMALL)[0] == 0
    several = ["--method", "sparse", "--ensemble", "e.exr", "--ensemble", "e2.exr"]
    status, found, _ = run("compress", "more.nacre", "m2.exr", *several, "--sparsity", "y=9,uv=3")
    assert status == 0 and found["sparsity"] == {"Y": 9, "U": 3, "V": 3}


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["compress", "a.nacre", "x.exr", "--method", "sparse"], "Nacre's ubo81: it is for 81"),
        (["compress", "a.nacre", "x.exr", "--ensemble", "e.exr"], "--method sparse"),
        (["compress", "more.nacre", "x.exr", "--method", "sparse", "--ensemble", "e.exr"], "views"),
        (
            ["compress", "a.nacre", "x.exr", "--method", "sparse", "--ensemble", "a.nacre"],
            "no ensemble",
        ),
        (
            ["compress", "a.nacre", "x.exr", "--method", "sparse", "--ensemble", "e.exr"]
            + ["--sparsity", "y=4"],
            "uv=",
        ),
        (
            ["compress", "a.nacre", "x.exr", "--method", "sparse", "--ensemble", "e.exr"]
            + ["--sparsity", "y=0,uv=1"],
            "Y=0",
        ),
        (
            ["compress", "a.nacre", "x.exr", "--method", "sparse", "--ensemble", "e.exr"]
            + ["--quality", "high"],
            "--quality",
        ),
        (["train", "a.nacre", "b.nacre"], ".exr"),
        (["train", "a.nacre", "more.nacre", "x.exr"], "directions"),
        (["train", "a.nacre", "x.exr", "--patch", "9"], "do not fit"),
        (["train", "a.nacre", "x.exr", "--sparsity", "y=1,w=2"], "expected"),
        (["train", "none.nacre", "x.exr"], "none.nacre"),
        (["decode", "m.exr", "x.nacre", "--quality", "0"], "1 or more"),
        (["decode", "e.exr", "x.nacre"], "e.exr"),
        (["decode", "m.exr", "x.nacre", "--interpolation", "image"], "--directions"),
        (["blend", "m.exr", "c.exr", "x.exr"], "--mix"),
        (["blend", "m.exr", "c.exr", "x.exr", "--mix", "1.5"], "from 0 to 1"),
        (["blend", "m.exr", "e.exr", "x.exr", "--mix", "0.5"], "e.exr"),
        (["blend", "m.exr", "c.exr", "x.png", "--mix", "0.5"], ".exr"),
        (["blend", "m.exr", "c.exr", "x.exr", "--mask", "tall.png"], "8 x 10 texels"),
        (["blend", "m.exr", "c.exr", "x.exr", "--mask", "none.png"], "none.png"),
        (["blend", "m.exr", "c.exr", "x.exr", "--mask", "a.nacre"], "a.nacre"),
        (["blend", "m.exr", "c.exr", "x.exr", "--mix", "0.5", "--sparsity", "y=3"], "uv="),
        (
            ["blend", "m.exr", "c.exr", "x.exr", "--mix", "0.5", "--quality", "9"]
            + ["--sparsity", "y=3,uv=1"],
            "--quality",
        ),
    ],
)
def test_mistakes_are_one_line(run, folder, arguments, word):
    before = {path.name for path in folder.iterdir()}
    status, _, line = run(*arguments)
    assert status == 2
    assert word in line and "\n" not in line
    assert {path.name for path in folder.iterdir()} == before
