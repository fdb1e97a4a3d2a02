"""BRDFs of the RGL and KAIST databases against Mitsuba's values, and damaged files."""

import json
from pathlib import Path

import numpy as np
import pytest
from brdf_files import PolarisedFile, RglFile, tensor_file

from addon.datasets import rgl
from addon.datasets.colour import spectrum_to_rec709
from addon.datasets.importing import describe_source, detect_format, import_dataset
from addon.datasets.options import Options
from addon.errors import NacreError

VALUES = Path(__file__).parents[1] / "fixtures" / "datasets" / "brdf_values.json"
SPECTRA = (400.0, 450.0, 520.0, 580.0, 640.0, 700.0)
FILES = {
    "isotropic, jacobian": RglFile(0),
    "isotropic, no jacobian": RglFile(0, jacobian=False),
    "whole, jacobian": RglFile(1),
    "whole, no jacobian": RglFile(1, jacobian=False),
    "half, jacobian": RglFile(2),
    "half, no jacobian": RglFile(2, jacobian=False),
    "quarter, jacobian": RglFile(4),
    "quarter, no jacobian": RglFile(4, jacobian=False),
    "isotropic spectra": RglFile(0, SPECTRA),
    "quarter spectra": RglFile(4, SPECTRA),
    "polarimetric": PolarisedFile(),
}


@pytest.fixture(scope="module")
def mitsuba():
    return json.loads(VALUES.read_text())


@pytest.fixture
def csv(tmp_path):
    def write(name, angles):
        path = tmp_path / name
        path.write_text("\n".join(["theta,phi", *(f"{theta},{phi}" for theta, phi in angles)]))
        return str(path)

    return write


def write(folder, file):
    path = folder / ("brdf.bsdf" if isinstance(file, RglFile) else "brdf.pbsdf")
    path.write_bytes(file.to_bytes())
    return path


def samples(path, **options):
    """(light, view, channel)."""
    source = rgl.open_source(path, Options(**options))
    return np.concatenate(list(source.blocks())).reshape(*source.shape)[:, :, 0, 0]


def test_every_kind_of_file_has_values_of_mitsubas(mitsuba):
    assert set(mitsuba["files"]) == set(FILES)


@pytest.mark.parametrize("name", FILES)
def test_values_are_mitsubas(name, mitsuba, tmp_path, csv):
    file = FILES[name]
    lights, views = csv("l.csv", mitsuba["lights"]), csv("v.csv", mitsuba["views"])
    ours = samples(write(tmp_path, file), lights=lights, views=views)
    theirs = np.pi * np.array(mitsuba["files"][name])
    if file.wavelengths:
        theirs = theirs @ spectrum_to_rec709(np.array(file.wavelengths, float)).T
    assert (theirs > 0).any(-1).all()
    # Mitsuba computes in single precision.
    scale = np.abs(theirs).max(-1, keepdims=True)
    assert (np.abs(ours - theirs) / scale).max() < (3e-5 if name == "polarimetric" else 4e-6)


@pytest.mark.parametrize("symmetry", [0, 1, 2, 4])
def test_a_diffuse_white_is_the_cosine_of_the_light_anywhere(symmetry, tmp_path, csv):
    """Also at the normal, in mirror directions and near the horizon, where the tables end."""
    file = RglFile(symmetry, jacobian=False)
    fields = file.fields()
    angles = [(t, p) for t in (0, 30, 60, 85, 89.99, 90) for p in (0, 90, 180, 270)]
    directions = csv("a.csv", angles)
    fields["rgb"] = np.full_like(fields["rgb"], 1 / np.pi)
    path = tmp_path / "a.bsdf"
    path.write_bytes(tensor_file(fields))
    values = samples(path, directions=directions)
    assert np.allclose(values[:20], 1.0, rtol=1e-6)  # f_r cos is what the file holds
    assert (values[20:] == 0.0).all()


def test_tables_that_are_zero_give_zero(tmp_path):
    fields = RglFile(2).fields()
    for name in ("sigma", "vndf"):
        fields[name] = np.zeros_like(fields[name])
    path = tmp_path / "a.bsdf"
    path.write_bytes(tensor_file(fields))
    assert (samples(path) == 0.0).all()


def test_two_slices_of_phi_are_isotropic(tmp_path):
    fields = RglFile(0).fields()
    path = tmp_path / "a.bsdf"
    path.write_bytes(tensor_file(fields))
    one = samples(path)
    fields["phi_i"] = np.array([-3, 3], "<f4")
    for name in ("vndf", "luminance", "rgb"):
        fields[name] = np.repeat(fields[name], 2, 0)
    path.write_bytes(tensor_file(fields))
    assert np.allclose(samples(path), one, rtol=1e-6)


def test_both_ends_of_the_turn_are_one_azimuth(tmp_path, csv):
    """The half vector opposite to the view, a last bit more or less."""
    path = tmp_path / "a.bsdf"
    path.write_bytes(RglFile(0).to_bytes())
    views = csv("v.csv", [(30, 0)])
    lights = csv("l.csv", [(60, 180 + turn) for turn in (-1e-11, 0, 1e-11)])
    values = samples(path, lights=lights, views=views)
    assert np.allclose(values[[0, 2]], values[[1, 1]], rtol=1e-6)


def test_values_below_0_and_what_is_no_number_are_0(tmp_path):
    fields = RglFile(0).fields()
    fields["rgb"][:, :, 1] = np.nan
    fields["rgb"][:, :, 2] = -1.0
    path = tmp_path / "a.bsdf"
    path.write_bytes(tensor_file(fields))
    values = samples(path)
    assert (values[..., 0] > 0).all()
    assert (values[..., 1:] == 0).all()


SIGNALLING_NAN = np.array([0x7F800001], "<u4").view("<f4")


def test_no_kind_of_nan_shows_as_a_warning(tmp_path):
    """Bytes that a processor complains about when it converts them."""
    fields = RglFile(0, SPECTRA).fields()
    path = tmp_path / "a.bsdf"
    fields["spectra"][:, :, 1] = SIGNALLING_NAN
    path.write_bytes(tensor_file(fields))
    assert np.isfinite(samples(path)).all()
    fields["wavelengths"][1:2] = SIGNALLING_NAN
    path.write_bytes(tensor_file(fields))
    with pytest.raises(NacreError, match="wavelengths do not increase"):
        describe_source(path)


def test_what_could_not_be_measured_is_0(tmp_path):
    whole = samples(write(tmp_path, PolarisedFile()))
    holes = samples(write(tmp_path, PolarisedFile(invalid=45)))
    changed = (whole != holes).any(-1)
    assert 0.01 < changed.mean() < 0.9
    assert (holes[changed] == 0).all()


def test_only_the_first_element_of_mueller_matrices_counts(tmp_path):
    file = PolarisedFile()
    first = samples(write(tmp_path, file))
    mueller = np.full_like(file.fields()["M"], np.nan)
    mueller[..., 0, 0] = file.fields()["M"][..., 0, 0]
    assert np.array_equal(samples(write(tmp_path, PolarisedFile(changes={"M": mueller}))), first)


def test_importing(tmp_path):
    path = write(tmp_path, RglFile(2, SPECTRA))
    assert detect_format(path) == "rgl"
    dataset = import_dataset(
        path, tmp_path / "a.nacre", lights="uniform:5", views="ubo151", patch_width=0.2
    )
    assert dataset.shape == (5, 151, 1, 1, 3)
    assert dataset.patch_size == (0.2, 0.2)
    assert dataset.source["conversions"] == [
        "spectra of 6 bands from 400 to 700 nm, seen under D65 by the CIE 1931 observer, to "
        "Rec.709; white, a flat spectrum of 1, is (1, 1, 1)",
        "f_r cos(theta_light) multiplied by pi; theta_i and phi_i taken as the view",
        "sampled at 5 lights (uniform:5) and 151 views (ubo151)",
        "a uniform BRDF has no scale: patch taken as 0.2 m wide, as asked",
    ]


def test_a_summary(tmp_path):
    path = write(tmp_path, RglFile(4))
    summary = describe_source(path)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert (summary["light"], summary["view"], summary["width"], summary["height"]) == (
        81,
        81,
        1,
        1,
    )
    assert summary["samples_bytes"] == 81 * 81 * 3 * 4
    assert summary["brdf"] == "anisotropic"
    assert summary["tables"]["vndf"] == [5, 4, 7, 9]
    assert summary["rgb"] == [5, 4, 3, 6, 6]
    assert describe_source(write(tmp_path, PolarisedFile()))["M"] == [9, 5, 6, 5, 4, 4]


def test_directions_are_given_once(tmp_path, csv):
    path = write(tmp_path, RglFile())
    both = csv("both.csv", [(0, 0), (10, 20)])
    assert samples(path, directions=both).shape == (2, 2, 3)
    with pytest.raises(NacreError, match="--directions, or --lights and --views, but not both"):
        describe_source(path, directions=both, lights="ubo81")
    with pytest.raises(NacreError, match="'ubo80': expected one of ubo81"):
        describe_source(path, views="ubo80")
    with pytest.raises(NacreError, match="brdf.bsdf is read as rgl, which takes no --gamma"):
        describe_source(path, gamma=2.2)


def test_the_mueller_matrices_are_not_loaded(tmp_path):
    """A real file has a gigabyte of them."""
    file = rgl.open_tensor_file(write(tmp_path, PolarisedFile()))
    stored = file.map(file.field("M", "f4", 6))
    assert np.shares_memory(stored, stored[..., 0, 0].reshape(-1, 5))


LARGER = np.ones((2, 2, 2, 2), "<f4")


@pytest.mark.parametrize(
    ("file", "message"),
    [
        (RglFile(changes={"vndf": None}), "has no field vndf; its fields: description, phi_i"),
        (RglFile(changes={"rgb": None}), "has no field rgb"),
        (RglFile(changes={"vndf": LARGER}), r"vndf has the shape \(2, 2, 2, 2\); expected \(1, 4,"),
        (RglFile(changes={"ndf": np.ones((1, 4), "<f4")}), r"ndf has the shape \(1, 4\)"),
        (RglFile(changes={"ndf": np.ones((4, 4))}), "ndf holds float64"),
        (RglFile(changes={"theta_i": np.zeros(4, "<f4")}), "theta_i do not increase"),
        (RglFile(changes={"theta_i": np.array([0, 1, np.nan, 2], "<f4")}), "theta_i do not"),
        (RglFile(changes={"phi_i": np.zeros(0, "<f4")}), "phi_i do not increase"),
        (RglFile(changes={"jacobian": np.zeros(2, "u1")}), "jacobian holds 2 values"),
        (RglFile(0, SPECTRA, changes={"wavelengths": np.ones(2, "<f4")}), "wavelengths do not"),
        (
            RglFile(0, SPECTRA, changes={"wavelengths": np.array([400, 500], "<f4")}),
            r"spectra has the shape \(1, 4, 6, 6, 6\); expected \(1, 4, 2, 2 or more, 2 or more\)",
        ),
        (
            RglFile(0, SPECTRA, changes={"wavelengths": np.arange(5000, dtype="<f4")}),
            "has 5000 wavelengths in the field wavelengths; up to 512 are read",
        ),
        (PolarisedFile(changes={"wvls": None}), "has no field wvls"),
        (PolarisedFile(changes={"wvls": np.array([450, 500], "<u2")}), "M has the shape"),
        (PolarisedFile(changes={"phi_d": np.ones((1, 9), "<f4")}), "phi_d do not increase"),
        (PolarisedFile(changes={"phi_d": np.ones((2, 9), "<f4")}), r"\(2, 9\); expected one row"),
    ],
)
def test_damaged_files_are_refused_in_one_line(file, message, tmp_path):
    path = write(tmp_path, file)
    with pytest.raises(NacreError, match=message) as caught:
        describe_source(path)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["vndf", "ndf", "sigma"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_tables_with_what_is_no_density_are_refused(name, value, tmp_path):
    fields = RglFile(1).fields()
    fields[name].flat[3] = value
    path = tmp_path / "a.bsdf"
    path.write_bytes(tensor_file(fields))
    with pytest.raises(NacreError, match=f"a.bsdf is damaged: the field {name} holds negative"):
        import_dataset(path, tmp_path / "a.nacre")
    assert [item.name for item in tmp_path.iterdir()] == ["a.bsdf"]
