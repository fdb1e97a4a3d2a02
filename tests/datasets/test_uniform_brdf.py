"""What is common to all BRDFs: coordinates, memory, one texel through the other steps."""

import tracemalloc

import numpy as np
import pytest
from brdf_files import (
    PolarisedFile,
    RglFile,
    anisotropic,
    from_half_difference,
    lambert,
    merl_file,
    utia_file,
)

from addon.datasets.brdf.uniform import half_difference
from addon.datasets.directions import unit_to_spherical
from addon.datasets.importing import READERS, describe_source, detect_format, import_dataset
from addon.datasets.options import Options

BIG = {"thetas": 8, "phis": 9, "size": 16, "warp": (64, 64)}
SPECTRUM = tuple(np.linspace(360.0, 1000.0, 100))
FILES = {
    "a.bsdf": lambda: RglFile(1, **BIG).to_bytes(),
    "spectra.bsdf": lambda: RglFile(0, SPECTRUM, **BIG).to_bytes(),
    "a.pbsdf": lambda: PolarisedFile().to_bytes(),
    "a.binary": lambda: merl_file(lambert),
    "a.bin": lambda: utia_file(anisotropic),
}


@pytest.fixture(scope="module", params=FILES)
def path(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("brdf") / request.param
    path.write_bytes(FILES[request.param]())
    return path


def test_half_and_difference_are_undone():
    rng = np.random.default_rng(4)
    angles = rng.uniform(0.05, [0.7, 0.7, 3.1], (200, 3)).T
    light, view = from_half_difference(*angles)
    turn = rng.uniform(0, 2 * np.pi)
    turned = np.array(
        [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    for found in (half_difference(light, view), half_difference(light @ turned, view @ turned)):
        assert np.allclose(found, angles)
    exchanged = half_difference(view, light)
    assert np.allclose(exchanged[2], angles[2] - np.pi)


@pytest.mark.parametrize(
    ("options", "pairs"),
    [({}, 6561), ({"lights": "uniform:300", "views": "uniform:40"}, 12000)],
)
def test_the_memory_told_beforehand_is_enough(path, options, pairs):
    told = describe_source(path, **options)["memory_bytes"]
    source = READERS[detect_format(path)].open_source(path, Options(**options))
    tracemalloc.start()
    try:
        samples = sum(block.size for block in source.blocks())
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert samples == 3 * pairs
    assert 0.2 * told < peak < 1.1 * told


def test_samples_do_not_depend_on_how_many_are_made_at_a_time(path):
    reader = READERS[detect_format(path)]
    many = reader.open_source(path, Options(lights="uniform:300"))
    blocks = list(many.blocks())
    assert len(blocks) > 1
    chosen = [0, 150, 299]
    csv = path.with_suffix(".csv")
    angles = zip(*unit_to_spherical(many.light[chosen]), strict=True)
    rows = [f"{float(theta)!r},{float(phi)!r}" for theta, phi in angles]
    csv.write_text("\n".join(["theta,phi", *rows]))
    few = reader.open_source(path, Options(lights=str(csv)))
    assert np.allclose(np.concatenate(list(few.blocks())), np.concatenate(blocks)[chosen])


def test_the_same_file_twice_is_the_same_dataset(path, tmp_path):
    first, second = (import_dataset(path, tmp_path / f"{n}.nacre") for n in "ab")
    assert np.array_equal(first.samples, second.samples)
    assert np.isfinite(first.samples).all()
