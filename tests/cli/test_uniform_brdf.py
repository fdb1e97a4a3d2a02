"""A uniform BRDF, a BTF of one texel, through every verb."""

import pytest
from brdf_files import RglFile, anisotropic, utia_file

from addon.datasets.importing import import_dataset
from addon.models.fit import compress, quality_settings
from addon.tables.against_model import tables_against_model
from addon.tables.tables import build_tables


@pytest.fixture(scope="module")
def brdf(tmp_path_factory):
    """A folder with two files of BRDFs, one of them anisotropic and smooth."""
    folder = tmp_path_factory.mktemp("brdf")
    (folder / "a.bin").write_bytes(utia_file(anisotropic))
    (folder / "a.bsdf").write_bytes(RglFile().to_bytes())
    return folder


def test_info_describes_it(brdf, nacre_json):
    said = nacre_json("info", brdf / "a.bsdf")
    assert (said["what"], said["format"], said["brdf"]) == ("measured file", "rgl", "isotropic")
    assert [said[name] for name in ("light", "view", "width", "height")] == [81, 81, 1, 1]


def test_options_reach_the_reader(brdf, nacre_json, files, tmp_path):
    said = nacre_json(
        "import", brdf / "a.bin", tmp_path / "a.nacre", "--lights", "uniform:9", "--views",
        "ubo151", "--gamma", "2.2", "--white", "0.5", "--patch-width", "0.25",
    )  # fmt: skip
    assert (said["light"], said["view"], said["patch_size"]) == (9, 151, [0.25, 0.25])
    said = " ".join(said["source"]["conversions"])
    for words in ("gamma 2.2, as asked", "0.5 taken as a white diffuser, as asked"):
        assert words in said
    said = nacre_json(
        "import",
        brdf / "a.bin",
        tmp_path / "b.nacre",
        "--directions",
        "some.csv",
        "--gamma",
        "srgb",
    )
    assert (said["light"], said["view"]) == (4, 4)


MISTAKES = [
    ("a.bsdf --gamma 2.2", "a.bsdf", "rgl", "takes no --gamma"),
    ("a.bsdf --colour-space xyz", "takes no --colour-space"),
    ("a.bsdf --lights uniform:0", "uniform:0", "1 to 4096"),
    ("a.bsdf --views bonn", "'bonn'", "ubo81"),
    ("a.bsdf --lights below.csv", "below.csv, line 3"),
    ("a.bsdf --directions some.csv --views ubo81", "--directions", "not both"),
    ("a.bin --gamma 0", "'0'", "above 0 or srgb"),
    ("a.bin --gamma rec709", "'rec709'", "above 0 or srgb"),
    ("a.bin --white -1", "'-1'"),
    ("a.bin --patch-width inf", "'inf'"),
    ("a.bin --colour-space srgb", "'srgb'", "xyz"),
]


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake[0])
def test_one_line_says_what_was_wrong(mistake, brdf, nacre, tmp_path):
    (name, *options), *words = mistake[0].split(), *mistake[1:]
    said = nacre("import", brdf / name, tmp_path / "d.nacre", *options, status=2)
    for word in words:
        assert word in said
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def dataset(brdf, tmp_path_factory):
    return import_dataset(brdf / "a.bin", tmp_path_factory.mktemp("brdf") / "a.nacre")


@pytest.mark.parametrize("method", ["nsvd", "cta", "kcta", "mkcta"])
@pytest.mark.parametrize("quality", ["draft", "high"])
def test_every_method_compresses_one_texel(method, quality, dataset, nacre_json, tmp_path):
    model = tmp_path / "a.exr"
    said = nacre_json(
        "compress", dataset.path, model, "--method", method, "--quality", quality,
        "--weights", "equal",
    )  # fmt: skip
    assert said["shape"] == [81, 81, 1, 1, 3]
    assert (said["ranks"]["x"], said["ranks"]["y"]) == (1, 1)
    assert nacre_json("info", model)["snr_db"] == said["snr_db"] > 20
    nacre_json("decode", model, tmp_path / "b.nacre")
    compared = nacre_json("compare", dataset.path, tmp_path / "b.nacre")
    # What is said of models that are nearly exact is an estimate.
    assert abs(min(compared["snr_db"], 45) - min(said["snr_db"], 45)) < 0.1


def test_targets(dataset, nacre_json, tmp_path):
    said = nacre_json("compress", dataset.path, tmp_path / "a.exr", "--target-db", "25")
    assert said["snr_db"] >= 25
    said = nacre_json("compress", dataset.path, tmp_path / "a.exr", "--target-mb", "0.03")
    assert said["bytes"] <= 30_000


def test_the_logarithm_and_other_directions(dataset, nacre_json, files, tmp_path):
    model = tmp_path / "a.exr"
    assert nacre_json("compress", dataset.path, model, "--domain", "log")["snr_db"] > 20
    said = nacre_json("decode", model, tmp_path / "b.nacre", "--directions", files / "some.csv")
    assert (said["light"], said["view"], said["width"]) == (4, 4, 1)


def test_few_directions_are_enough(brdf, nacre_json, tmp_path):
    for count in (1, 2):
        folder = tmp_path / str(count)
        few = f"uniform:{count}"
        nacre_json("import", brdf / "a.bin", f"{folder}.nacre", "--lights", few, "--views", few)
        said = nacre_json("compress", f"{folder}.nacre", f"{folder}.exr")
        assert said["snr_db"] > 60


def test_tables_of_one_texel_are_the_model(dataset):
    """What a material and `verify` show of it."""
    model = compress(dataset, "kcta", **quality_settings(dataset, "kcta", "MEDIUM"))
    errors = tables_against_model(model, build_tables(model))
    assert errors["relative"] < 0.02


def test_a_material_of_one_texel(dataset, nacre_json, tmp_path):
    pytest.importorskip("bpy")
    nacre_json("compress", dataset.path, tmp_path / "a.exr", "--quality", "draft")
    said = nacre_json("material", tmp_path / "a.exr", tmp_path / "a.blend")
    assert (tmp_path / "a.blend").stat().st_size == said["bytes"]
