"""Occlusion through the command line: masks in, a model, masks out, and every mistake."""

import json

import numpy as np
import pytest
from fibres import fibre_masks, views
from PIL import Image

from addon.cli import main
from addon.datasets.dataset import open_dataset
from addon.datasets.directions import unit_to_spherical
from addon.datasets.occlusion import is_covered, signed_distance
from addon.models.exr import load_model

VIEWS = views(around=8)
MASKS = fibre_masks(VIEWS, 24)
SETTINGS = ["--ranks", "view=4,y=16,x=16", "--clusters", "view=6"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Masks, their directions, a dataset and a model of each encoding."""
    folder = tmp_path_factory.mktemp("occlusion")
    np.save(folder / "masks.npy", MASKS)
    angles = np.stack(unit_to_spherical(VIEWS), -1)
    lines = "".join(f"{theta},{phi}\n" for theta, phi in angles)
    (folder / "views.csv").write_text("theta,phi\n" + lines)
    dataset = str(folder / "o.nacre")
    views_csv = ["--directions", str(folder / "views.csv")]
    assert main(["import", str(folder / "masks.npy"), dataset, *views_csv]) == 0
    for encoding in ("distance", "mask"):
        model = str(folder / f"{encoding}.exr")
        assert main(["compress", dataset, model, *SETTINGS, "--encoding", encoding]) == 0
    return folder


@pytest.fixture
def run(folder, monkeypatch, capfd):
    """A function that runs a verb in the folder: the object it printed, or its line of error."""
    monkeypatch.chdir(folder)

    def run(command, *more, status=0):
        assert main([*command.split(), *map(str, more), "--json"]) == status
        out, err = capfd.readouterr()
        if status:
            assert err.startswith("nacre: ")
            assert err.count("\n") == 1
            return err
        return json.loads(out.splitlines()[-1])

    return run


def wrong_texels(model):
    return int(np.count_nonzero(is_covered(model.decode(), model.dataset["value"]) != MASKS))


def test_import_says_what_it_made(run, folder):
    said = run("info o.nacre")
    assert said["what"] == "dataset"
    assert (said["kind"], said["value"], said["view"]) == ("occlusion", "mask", len(VIEWS))
    assert (said["width"], said["height"]) == (24, 24)
    assert "light" not in said and "channels" not in said
    assert said["raw_bytes"] == 4 * MASKS.size
    assert run("import masks.npy again.nacre --directions views.csv") == said


def test_a_folder_of_images_is_the_same(run, folder, tmp_path):
    (tmp_path / "images").mkdir()
    for number, mask in enumerate(MASKS):
        pixels = np.where(mask[::-1], 255, 0).astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / "images" / f"{number}.png")
    run("import", tmp_path / "images", tmp_path / "a.nacre", "--directions", "views.csv")
    np.testing.assert_array_equal(open_dataset(tmp_path / "a.nacre").samples, MASKS)


def test_compress_fits_distances_unless_told(run, folder, tmp_path):
    said = run("compress o.nacre", tmp_path / "m.exr", *SETTINGS)
    assert (said["kind"], said["value"]) == ("occlusion", "signed-distance")
    assert said["shape"] == list(MASKS.shape)
    assert said["mixtures"] == {"view": 3}
    np.testing.assert_array_equal(
        load_model(tmp_path / "m.exr").decode(), load_model(folder / "distance.exr").decode()
    )
    assert run("info mask.exr")["value"] == "mask"
    assert load_model(folder / "mask.exr").dataset["source"]["conversions"][:-1] == []
    (conversion,) = load_model(tmp_path / "m.exr").dataset["source"]["conversions"][-1:]
    assert "signed distances" in conversion


@pytest.mark.parametrize("method", ["nsvd", "cta", "kcta", "mkcta"])
def test_every_method_takes_occlusion(method, run, tmp_path):
    said = run(f"compress o.nacre {tmp_path / 'm.exr'} --method {method} --quality draft")
    assert said["method"] == method
    assert run("compare o.nacre", tmp_path / "m.exr")["error_texels"] < 0.1 * MASKS.size


@pytest.mark.parametrize("encoding", ["distance", "mask"])
def test_decode_gives_masks(encoding, run, folder, tmp_path):
    said = run(f"decode {encoding}.exr", tmp_path / "d.nacre")
    assert (said["kind"], said["value"], said["dtype"]) == ("occlusion", "mask", "float16")
    decoded, model = open_dataset(tmp_path / "d.nacre"), load_model(folder / f"{encoding}.exr")
    expected = model.decode() > (0 if encoding == "distance" else 0.5)
    np.testing.assert_array_equal(decoded.samples, expected)
    np.testing.assert_array_equal(decoded.view, model.dataset["view"])
    assert decoded.periodic is True


@pytest.mark.parametrize("encoding", ["distance", "mask"])
def test_decode_gives_the_fitted_values(encoding, run, folder, tmp_path):
    said = run(f"decode {encoding}.exr --raw", tmp_path / "d.nacre")
    model = load_model(folder / f"{encoding}.exr")
    assert (said["value"], said["dtype"]) == (model.dataset["value"], "float32")
    samples = open_dataset(tmp_path / "d.nacre").samples
    np.testing.assert_allclose(samples, model.decode(), atol=1e-5)
    exact = signed_distance(MASKS, True) if encoding == "distance" else MASKS
    assert np.sum((samples - exact) ** 2) < 0.05 * np.sum(exact.astype(float) ** 2)


def test_decode_gives_a_block(run, folder, tmp_path):
    run("decode distance.exr --raw --view 3:9 --y :6 --x=-8:", tmp_path / "d.nacre")
    decoded, model = open_dataset(tmp_path / "d.nacre"), load_model(folder / "distance.exr")
    np.testing.assert_allclose(decoded.samples, model.decode()[3:9, :6, -8:], atol=1e-5)
    np.testing.assert_array_equal(decoded.view, model.dataset["view"][3:9])
    assert decoded.patch_size == pytest.approx((0.01 * 8 / 24, 0.01 * 6 / 24))
    assert decoded.periodic is False


def test_compare_counts_error_texels(run, folder, tmp_path):
    for encoding in ("distance", "mask"):
        said = run(f"compare o.nacre {encoding}.exr")
        assert said["error_texels"] == wrong_texels(load_model(folder / f"{encoding}.exr")) > 0
        run(f"decode {encoding}.exr", tmp_path / "d.nacre")
        assert run("compare o.nacre", tmp_path / "d.nacre")["error_texels"] == said["error_texels"]
    assert run("compare o.nacre o.nacre")["error_texels"] == 0
    assert run("compare mask.exr distance.exr")["error_texels"] > 0


def test_compare_measures_masks_against_distances_as_masks(run, folder):
    said = run("compare o.nacre distance.exr")
    wrong = wrong_texels(load_model(folder / "distance.exr"))
    assert said["mse"] == pytest.approx(wrong / MASKS.size)
    assert said["snr_db"] == pytest.approx(10 * np.log10(MASKS.sum() / wrong))


def test_compare_measures_equal_values_as_they_are(run, folder, tmp_path):
    raw = load_model(folder / "mask.exr").decode()
    assert run("compare o.nacre mask.exr")["mse"] == pytest.approx(np.mean((raw - MASKS) ** 2))
    run("decode distance.exr --raw", tmp_path / "d.nacre")
    said = run("compare", tmp_path / "d.nacre", "distance.exr")
    assert (said["error_texels"], said["mse"]) == (0, pytest.approx(0.0, abs=1e-12))


def test_fewer_wrong_texels_at_the_same_size(run):
    """Of distances, whose file may not be the larger one."""
    distance, mask = (run(f"compare o.nacre {name}.exr") for name in ("distance", "mask"))
    assert distance["error_texels"] < mask["error_texels"]
    assert distance["bytes_b"] < 1.1 * mask["bytes_b"]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("import masks.npy n.nacre", ["--directions"]),
        ("import masks.npy n.nacre --directions absent.csv", ["absent.csv"]),
        ("import masks.npy n.nacre --directions views.csv --cosine 1", ["--cosine"]),
        ("info masks.npy", ["--directions"]),
        ("compress o.nacre n.exr --encoding binary", ["'binary'", "distance", "mask"]),
        ("compress o.nacre n.exr --ranks light=4", ["'light'", "view, y, x"]),
        ("compress o.nacre n.exr --global light", ["'light'", "y or x"]),
        ("decode distance.exr n.nacre --light 0:1", ["--light"]),
        ("decode distance.exr n.nacre --view 33:", ["--view"]),
    ],
    ids=str,
)
def test_mistakes_are_one_line(command, words, run, folder):
    before = sorted(folder.iterdir())
    said = run(command, status=2)
    for word in words:
        assert word in said
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    "command", ["verify distance.exr", "material distance.exr m.blend", "render distance.exr p.png"]
)
def test_what_shows_models_refuses_occlusion(command, run, folder):
    pytest.importorskip("bpy", reason="Blender is not installed")
    assert "a model of occlusion has no colours" in run(command, status=2)


def test_what_is_for_occlusion_refuses_a_btf(nacre, listing):
    before = listing()
    assert "--encoding" in nacre("compress", "small.nacre", "m.exr", "--encoding=mask", status=2)
    assert "--raw" in nacre("decode", "kcta.exr", "d.nacre", "--raw", status=2)
    said = nacre("import", "good.btf", "d.nacre", "--directions", "some.csv", status=2)
    assert "takes no --directions" in said
    assert listing() == before
