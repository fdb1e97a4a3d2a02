"""What each verb that needs no Blender does and prints."""

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from addon import samples
from addon.datasets.dataset import open_dataset
from addon.datasets.directions import read_directions_csv, unit_to_spherical
from addon.models.exr import load_model
from addon.models.fit import compress, quality_settings
from addon.models.interpolation import horizon_fade
from addon.models.resample import resample

RANKS = "--ranks light=5,view=3,y=4,x=5"
KCTA = f"--method kcta {RANKS} --clusters view=3 --mixtures view=2".split()


@pytest.mark.parametrize(
    ("source", "shape"), [("good.btf", [3, 2, 5, 4]), ("good.zip", [3, 2, 4, 3])]
)
def test_import_makes_a_dataset(source, shape, nacre_json, tmp_path):
    said = nacre_json("import", source, tmp_path / "new.nacre")
    assert said["what"] == "dataset"
    assert [said[name] for name in ("light", "view", "width", "height")] == shape
    dataset = open_dataset(tmp_path / "new.nacre")
    assert said["raw_bytes"] == dataset.raw_bytes
    assert said["source"]["file"] == source
    assert nacre_json("info", tmp_path / "new.nacre") == said


def test_import_takes_format_and_cosine(nacre_json, tmp_path):
    with_cosine = nacre_json(
        "import", "good.btf", tmp_path / "a.nacre", "--format", "btf", "--cosine", "0"
    )
    assert with_cosine["source"]["conversions"]
    assert not np.array_equal(
        open_dataset(tmp_path / "a.nacre").samples[1:],
        open_dataset(import_plainly(nacre_json, tmp_path)).samples[1:],
    )


def import_plainly(nacre_json, tmp_path):
    nacre_json("import", "good.btf", tmp_path / "plain.nacre")
    return tmp_path / "plain.nacre"


def test_info_describes_datasets_models_and_measured_files(nacre_json, files):
    dataset = nacre_json("info", "small.nacre")
    assert dataset["what"] == "dataset"
    assert dataset["channels"] == ["R", "G", "B"]
    model = nacre_json("info", "kcta.exr")
    assert model["what"] == "model"
    assert model["method"] == "kcta"
    assert model["shape"] == [6, 7, 8, 10, 3]
    assert model["ranks"] == {"light": 5, "view": 3, "y": 4, "x": 5}
    assert model["clusters"] == {"view": 3}
    assert model["mixtures"] == {"view": 2}
    assert model["bytes"] == (files / "kcta.exr").stat().st_size
    assert model["ratio"] == round(dataset["raw_bytes"] / model["bytes"], 2)
    for name, kind in (("good.btf", "btf"), ("good.zip", "ubo2003")):
        measured = nacre_json("info", name)
        assert measured["what"] == "measured file"
        assert measured["format"] == kind
        assert (measured["light"], measured["view"]) == (3, 2)
        assert measured["bytes"] == (files / name).stat().st_size


def test_people_read_one_value_a_line(nacre):
    lines = nacre("info", "kcta.exr").splitlines()
    pairs = dict(line.split(maxsplit=1) for line in lines if len(line.split()) > 1)
    assert pairs["method"] == "kcta"
    assert pairs["bytes"].isdigit()
    assert lines[lines.index("clusters") + 1].split() == ["view", "3"]
    assert "errors" not in pairs
    assert nacre("compare", "a.png", "b.png").startswith("snr_db ")


def test_compress_does_what_it_is_told(nacre_json, tmp_path, small):
    said = nacre_json("compress", "small.nacre", tmp_path / "m.exr", *KCTA, "--seed", "4")
    model = load_model(tmp_path / "m.exr")
    assert said == nacre_json("info", tmp_path / "m.exr")
    assert (said["method"], said["seed"]) == ("kcta", 4)
    expected = compress(
        small, "kcta", ranks=model.ranks, clusters={"view": 3}, mixtures={"view": 2}, seed=4
    )
    np.testing.assert_allclose(model.decode(), expected.decode(), rtol=0.01, atol=1e-3)


def test_global_modes_may_be_chosen(nacre_json, tmp_path):
    for given, owners in (("", [3, 3, 3]), ("light,x", [1, 3, 1]), ("light", [1, 3, 3])):
        nacre_json("compress", "small.nacre", tmp_path / "m.exr", *KCTA, "--global", given)
        bases = load_model(tmp_path / "m.exr").bases
        assert [len(bases[mode]) for mode in ("light", "y", "x")] == owners


def test_quality_fills_in_what_is_not_given(nacre_json, tmp_path, small):
    for method in ("nsvd", "cta", "kcta"):
        for quality in ("draft", "medium", "HIGH"):
            expected = quality_settings(small, method, quality.upper())
            said = nacre_json(
                "compress", "small.nacre", tmp_path / "m.exr", f"--method={method}",
                f"--quality={quality}",
            )  # fmt: skip
            assert said["ranks"] == expected["ranks"]
            assert said["clusters"] == expected.get("clusters", {})
            assert said["mixtures"] == expected.get("mixtures", {})
    said = nacre_json("compress", "small.nacre", tmp_path / "m.exr", "--ranks", "light=2")
    assert said["ranks"] == {**quality_settings(small, "kcta")["ranks"], "light": 2}


def test_decode_gives_the_samples_back(nacre_json, tmp_path, files):
    said = nacre_json("decode", "kcta.exr", tmp_path / "d.nacre")
    assert said["dtype"] == "float32"
    decoded, model = open_dataset(tmp_path / "d.nacre"), load_model(files / "kcta.exr")
    assert decoded.samples.min() < 0.0  # not clamped
    np.testing.assert_allclose(decoded.samples, model.decode(), rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(decoded.light, model.dataset["light"])
    np.testing.assert_array_equal(decoded.view, model.dataset["view"])
    assert decoded.patch_size == (0.02, 0.01)
    assert decoded.periodic is True
    assert decoded.source == model.dataset["source"]


def test_decode_gives_a_block_back(nacre_json, tmp_path, files):
    nacre_json(
        "decode", "kcta.exr", tmp_path / "d.nacre",
        "--light", "1:4", "--view", "5:", "--y", ":6", "--x=-3:-1",
    )  # fmt: skip
    decoded, model = open_dataset(tmp_path / "d.nacre"), load_model(files / "kcta.exr")
    assert decoded.shape == (3, 2, 6, 2, 3)
    expected = model.decode()[1:4, 5:, :6, -3:-1]
    np.testing.assert_allclose(decoded.samples, expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(decoded.light, model.dataset["light"][1:4])
    np.testing.assert_array_equal(decoded.view, model.dataset["view"][5:])
    assert decoded.patch_size == pytest.approx((0.02 * 2 / 10, 0.01 * 6 / 8))
    assert decoded.periodic is False


def test_a_model_of_logarithms_says_so_and_decodes_to_linear_values(nacre_json, tmp_path, small):
    said = nacre_json("compress", "small.nacre", tmp_path / "m.exr", *KCTA, "--domain", "log")
    assert said["domain"] == "log"
    assert said == nacre_json("info", tmp_path / "m.exr")
    compared = nacre_json("compare", "small.nacre", tmp_path / "m.exr")
    assert compared["snr_db"] == pytest.approx(said["snr_db"], abs=0.01)
    nacre_json("decode", tmp_path / "m.exr", tmp_path / "d.nacre")
    decoded = open_dataset(tmp_path / "d.nacre").samples
    np.testing.assert_allclose(decoded, load_model(tmp_path / "m.exr").decode(), rtol=1e-4)
    assert nacre_json("info", "kcta.exr")["domain"] == "linear"


@pytest.mark.parametrize("model", ["kcta.exr", "nsvd.exr", "mkcta.exr", "log.exr"])
def test_decode_interpolates_any_directions(model, nacre_json, tmp_path, files):
    nacre_json("decode", model, tmp_path / "d.nacre", "--directions", "some.csv")
    decoded = open_dataset(tmp_path / "d.nacre")
    directions = read_directions_csv(files / "some.csv")
    np.testing.assert_array_equal(decoded.light, directions)
    np.testing.assert_array_equal(decoded.view, directions)
    assert decoded.samples.dtype == np.float32
    stored = load_model(files / model)
    expected = resample(stored, directions, directions).decode()
    # The last light is below the lowest measured one: its values fade with its cosine.
    fade = horizon_fade(np.asarray(stored.dataset["light"]), directions)
    assert (fade[:-1] == 1.0).all()
    assert 0.0 < fade[-1] < 0.6
    expected *= fade[:, None, None, None, None]
    np.testing.assert_allclose(decoded.samples, expected, rtol=1e-5, atol=1e-6)
    nacre_json(
        "decode", model, tmp_path / "part.nacre", "--directions", "some.csv",
        "--light", "1:2", "--view", "2:", "--y", "3:5",
    )  # fmt: skip
    part = open_dataset(tmp_path / "part.nacre")
    np.testing.assert_allclose(part.samples, decoded.samples[1:2, 2:, 3:5], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("model", ["kcta.exr", "nsvd.exr", "mkcta.exr", "log.exr"])
def test_decode_at_the_measured_directions_is_decode(model, nacre_json, tmp_path, files):
    lights, views = (load_model(files / model).dataset[mode] for mode in ("light", "view"))
    rows = [f"{theta:.9f},{phi:.9f}" for theta, phi in zip(*unit_to_spherical(views), strict=True)]
    (tmp_path / "views.csv").write_text("\n".join(["theta,phi", *rows]))
    nacre_json("decode", model, tmp_path / "a.nacre", "--directions", tmp_path / "views.csv")
    nacre_json("decode", model, tmp_path / "b.nacre", "--light", "0:1")
    np.testing.assert_allclose(lights[0], views[0])  # the first light is the first view
    np.testing.assert_allclose(
        open_dataset(tmp_path / "a.nacre").samples[:1],
        open_dataset(tmp_path / "b.nacre").samples,
        rtol=1e-4,
        atol=1e-5,
    )


def test_compare_measures_datasets_and_models(nacre_json, files, small):
    said = nacre_json("compare", "small.nacre", "kcta.exr")
    a, b = small.samples.astype(float), load_model(files / "kcta.exr").decode().astype(float)
    error = np.sum((a - b) ** 2)
    assert said["snr_db"] == pytest.approx(10 * np.log10(np.sum(a**2) / error))
    assert said["psnr_db"] == pytest.approx(10 * np.log10(np.max(np.abs(a)) ** 2 / error * a.size))
    assert said["mse"] == pytest.approx(error / a.size)
    assert said["max_abs"] == pytest.approx(np.abs(a - b).max())
    assert said["bytes_a"] == sum(
        (files / "small.nacre" / name).stat().st_size for name in ("samples.npy", "dataset.json")
    )
    assert said["bytes_b"] == (files / "kcta.exr").stat().st_size


@pytest.mark.parametrize("size", [1, 7 * 8 * 10 * 3 * 4 * 4])
def test_blocks_of_any_size_give_the_same(size, nacre_json, monkeypatch, tmp_path, files):
    """One light at a time, and four and then the other two."""
    whole = nacre_json("compare", "small.nacre", "kcta.exr")
    monkeypatch.setattr(samples, "BLOCK_BYTES", size)
    assert nacre_json("compare", "small.nacre", "kcta.exr") == pytest.approx(whole, rel=1e-5)
    nacre_json("decode", "kcta.exr", tmp_path / "d.nacre")
    expected = load_model(files / "kcta.exr").decode()
    decoded = open_dataset(tmp_path / "d.nacre").samples
    np.testing.assert_allclose(decoded, expected, rtol=1e-4, atol=1e-5)


def test_compare_agrees_with_decode_and_the_fit(nacre_json, tmp_path):
    fitted = nacre_json("compress", "small.nacre", tmp_path / "m.exr", *KCTA)
    nacre_json("decode", tmp_path / "m.exr", tmp_path / "d.nacre")
    with_model = nacre_json("compare", "small.nacre", tmp_path / "m.exr")
    with_dataset = nacre_json("compare", "small.nacre", tmp_path / "d.nacre")
    assert with_model["snr_db"] == pytest.approx(with_dataset["snr_db"], abs=1e-3)
    assert with_model["snr_db"] == pytest.approx(fitted["snr_db"], abs=0.01)


def test_equal_things_have_no_ratio(nacre_json):
    """JSON has no infinity."""
    said = nacre_json("compare", "small.nacre", "small.nacre")
    assert said["snr_db"] is said["psnr_db"] is None
    assert said["mse"] == said["max_abs"] == 0.0


def test_compare_takes_the_peak_of_a_png_as_1(nacre_json, files):
    said = nacre_json("compare", "a.png", "b.png")
    a, b = (np.asarray(Image.open(files / name), float) / 255 for name in ("a.png", "b.png"))
    mse = np.mean((a - b) ** 2)
    assert said["mse"] == pytest.approx(mse)
    assert said["psnr_db"] == pytest.approx(-10 * np.log10(mse))


def write_picture(path, pixels):
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"RGB": pixels.astype(np.float32)}).write(str(path))


def test_compare_takes_the_peak_of_an_exr_from_a(nacre_json, tmp_path):
    rng = np.random.default_rng(1)
    a, b = rng.random((2, 6, 5, 3)) * 7
    write_picture(tmp_path / "a.exr", a)
    write_picture(tmp_path / "b.exr", b)
    said = nacre_json("compare", tmp_path / "a.exr", tmp_path / "b.exr")
    mse = np.mean((a - b) ** 2)
    assert said["psnr_db"] == pytest.approx(10 * np.log10(a.max() ** 2 / mse), rel=1e-5)
    assert said["snr_db"] == pytest.approx(10 * np.log10(np.mean(a**2) / mse), rel=1e-5)


def test_a_png_and_an_exr_are_the_same_way_up(nacre_json, tmp_path, files):
    pixels = np.asarray(Image.open(files / "a.png"), float) / 255
    write_picture(tmp_path / "a.exr", pixels)
    assert nacre_json("compare", "a.png", tmp_path / "a.exr")["max_abs"] < 1e-6


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_no_numbers_are_not_compared(value, nacre, tmp_path):
    pixels = np.ones((3, 4, 3))
    write_picture(tmp_path / "a.exr", pixels)
    pixels[1, 2, 0] = value
    write_picture(tmp_path / "b.exr", pixels)
    for pair in (("a.exr", "b.exr"), ("b.exr", "a.exr")):
        assert "finite" in nacre("compare", *(tmp_path / name for name in pair), status=2)


def test_black_against_anything_has_no_ratio(nacre_json, tmp_path):
    write_picture(tmp_path / "black.exr", np.zeros((3, 4, 3)))
    write_picture(tmp_path / "white.exr", np.ones((3, 4, 3)))
    said = nacre_json("compare", tmp_path / "black.exr", tmp_path / "white.exr")
    assert said["snr_db"] is None
    assert said["mse"] == 1.0
