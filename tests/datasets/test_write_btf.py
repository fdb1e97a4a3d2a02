"""Datasets to .btf files and back."""

import os
import tracemalloc

import numpy as np
import pytest

from addon.datasets import btf_writer
from addon.datasets.btf_writer import write_btf
from addon.datasets.dataset import DatasetWriter, open_dataset
from addon.datasets.direction_sets import uniform
from addon.datasets.importing import describe_source, import_dataset
from addon.datasets.quality import compare_blocks
from addon.datasets.truncated_svd import TruncatedSvd
from addon.errors import Cancelled, NacreError

SHAPE = (6, 7, 5, 8, 3)


def make_dataset(path, samples, **changes):
    lights, views = samples.shape[:2]
    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": uniform(lights).tolist(),
        "view": uniform(views)[::-1].tolist(),
        "channels": ["R", "G", "B"],
        "patch_size": [0.08, 0.05],
        "periodic": True,
        "noise_floor_db": None,
        "source": {},
        **changes,
    }
    with DatasetWriter(path, description, samples.shape, samples.dtype) as writer:
        writer.write(samples)
    return open_dataset(path)


def smooth(shape=SHAPE, seed=0):
    """Positive samples of three components a channel and a little noise."""
    rng = np.random.default_rng(seed)
    lights, views, height, width, channels = shape
    factors = rng.random((lights, views, channels, 3)), rng.random((height, width, channels, 3))
    samples = np.einsum("lvck,yxck->lvyxc", *factors) + 0.01 * rng.random(shape)
    return samples.astype(np.float32)


@pytest.fixture
def dataset(tmp_path):
    return make_dataset(tmp_path / "a.nacre", smooth())


@pytest.mark.parametrize("colour_model", [0, 11])
def test_with_all_components_it_is_the_dataset(tmp_path, dataset, colour_model):
    made = write_btf(dataset, tmp_path / "a.btf", components=42, colour_model=colour_model)
    back = import_dataset(tmp_path / "a.btf", tmp_path / "b.nacre")
    np.testing.assert_allclose(back.samples, dataset.samples, rtol=0.01, atol=0.005)
    for axis in ("light", "view"):
        np.testing.assert_allclose(getattr(back, axis), getattr(dataset, axis), atol=1e-6)
    assert back.patch_size == pytest.approx(dataset.patch_size)
    assert made["components"] == [40, 40, 40]
    assert made["snr_db"] > 55
    assert made["bytes"] == (tmp_path / "a.btf").stat().st_size
    summary = describe_source(tmp_path / "a.btf")
    assert (summary["layout"], summary["cosine_flag"]) == ("DFMF", 1)
    assert summary["colour_model"].startswith(f"{colour_model} ")
    assert sorted(os.listdir(tmp_path)) == ["a.btf", "a.nacre", "b.nacre"]


@pytest.mark.parametrize("colour_model", [0, 11])
def test_the_snr_is_what_comes_back(tmp_path, dataset, colour_model):
    made = write_btf(dataset, tmp_path / "a.btf", components=(4, 2, 3), colour_model=colour_model)
    back = import_dataset(tmp_path / "a.btf", tmp_path / "b.nacre")
    measured = compare_blocks([(dataset.samples, np.asarray(back.samples))])
    assert made["components"] == describe_source(tmp_path / "a.btf")["components"] == [4, 2, 3]
    assert made["snr_db"] == pytest.approx(measured["snr_db"], abs=0.01)
    assert 15 < made["snr_db"] < 50


def test_it_is_the_best_of_so_many_components(tmp_path, dataset):
    """By numpy's decomposition of each channel."""
    made = write_btf(dataset, tmp_path / "a.btf", components=3)
    error = 0.0
    for channel in range(3):
        matrix = dataset.samples[..., channel].reshape(42, 40).astype(float)
        error += (np.linalg.svd(matrix, compute_uv=False)[3:] ** 2).sum()
    best = 10 * np.log10((dataset.samples.astype(float) ** 2).sum() / error)
    assert best - 0.1 < made["snr_db"] <= best + 1e-3


def test_a_slow_decay_converges():
    """White noise, the hardest spectrum: within 0.15 dB of the best after the passes there are."""
    matrix = np.random.default_rng(3).standard_normal((400, 300)).astype(np.float32)
    svd = TruncatedSvd(400, 300, 40)
    for number in range(btf_writer._PASSES):
        for first in range(0, 400, 90):
            rows = slice(first, min(first + 90, 400))
            svd.add(rows, matrix[rows])
        if number < btf_writer._PASSES - 1:
            svd.end_pass()
    values, left, right = svd.factors()
    np.testing.assert_allclose(left.T @ left, np.eye(40), atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(right, axis=0), values, rtol=1e-5)
    found = ((matrix - left @ right.T) ** 2).sum()
    best = (np.linalg.svd(matrix, compute_uv=False)[40:] ** 2).sum()
    assert best * (1 - 1e-5) < found < best * 10**0.015


def test_large_values_are_written_in_single_precision(tmp_path):
    samples = smooth() * 1e5
    made = write_btf(make_dataset(tmp_path / "a.nacre", samples), tmp_path / "a.btf")
    assert made["scalar"] == "float32"
    back = import_dataset(tmp_path / "a.btf", tmp_path / "b.nacre")
    np.testing.assert_allclose(back.samples, samples, rtol=1e-3)


def test_values_below_0_become_0_where_they_have_no_logarithm(tmp_path):
    samples = smooth()
    samples[2, 3] = [-0.5, 1e-3, -0.01]
    dataset = make_dataset(tmp_path / "a.nacre", samples)
    write_btf(dataset, tmp_path / "a.btf", colour_model=11)
    back = import_dataset(tmp_path / "a.btf", tmp_path / "b.nacre")
    np.testing.assert_allclose(back.samples[2, 3], np.maximum(samples[2, 3], 0), atol=1e-3)
    np.testing.assert_allclose(back.samples[3], samples[3], rtol=0.02, atol=0.01)


def test_memory_is_for_factors_and_a_block(tmp_path, monkeypatch):
    shape = (24, 25, 32, 32, 3)
    dataset = make_dataset(tmp_path / "a.nacre", smooth(shape))
    monkeypatch.setattr(btf_writer, "BLOCK_BYTES", 4 * 32 * 32 * 3 * 4)
    tracemalloc.start()
    write_btf(dataset, tmp_path / "a.btf", components=4)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert dataset.raw_bytes > 7_000_000
    assert peak < 1_600_000


def test_the_same_bytes_each_time(tmp_path, dataset):
    for name in ("a.btf", "b.btf"):
        write_btf(dataset, tmp_path / name, components=5)
    assert (tmp_path / "a.btf").read_bytes() == (tmp_path / "b.btf").read_bytes()


def test_progress_and_cancelling(tmp_path, dataset):
    calls = []
    write_btf(dataset, tmp_path / "a.btf", progress=lambda done, text: calls.append(done) or True)
    assert calls == sorted(calls)
    assert (calls[0], calls[-1]) == (0.0, 1.0)
    before = (tmp_path / "a.btf").read_bytes()
    for after in (0, len(calls) // 2, len(calls) - 1):
        left = iter([True] * after)
        with pytest.raises(Cancelled):
            write_btf(dataset, tmp_path / "a.btf", progress=lambda *_, left=left: next(left, False))
        assert (tmp_path / "a.btf").read_bytes() == before
        assert sorted(os.listdir(tmp_path)) == ["a.btf", "a.nacre"]


@pytest.mark.parametrize(
    ("changes", "options", "says"),
    [
        ({"channels": ["X", "Y", "Z"]}, {}, "channels X, Y, Z, not R, G, B"),
        ({"view": [[0, 0, -1]] * 7}, {}, "view 0 has theta 180, below the surface"),
        ({}, {"components": 0}, "components must be a number from 1 on"),
        ({}, {"components": (3, 4)}, "or three, not"),
        ({}, {"colour_model": 9}, "colour model 9 is not written: choose 0 or 11"),
    ],
)
def test_what_cannot_be_written_is_one_clear_error(tmp_path, changes, options, says):
    dataset = make_dataset(tmp_path / "a.nacre", smooth(), **changes)
    with pytest.raises(NacreError, match=says):
        write_btf(dataset, tmp_path / "a.btf", **options)
    assert os.listdir(tmp_path) == ["a.nacre"]


def test_where_it_cannot_be_written(tmp_path, dataset):
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "absent" / "a.btf", tmp_path / "folder"):
        with pytest.raises(NacreError, match="cannot write"):
            write_btf(dataset, path)
    assert sorted(os.listdir(tmp_path)) == ["a.nacre", "folder"]


@pytest.mark.acceptance
@pytest.mark.parametrize("colour_model", [0, 11])
def test_an_independent_reader_reads_it(tmp_path, colour_model):
    """btf-extractor (Python 3.11; see fixtures/datasets/make_independent_values.py)."""
    extractor = pytest.importorskip("btf_extractor", reason="btf-extractor is not installed")
    # It takes as many lights as views, and their directions to be the same.
    samples = 0.3 * smooth((7, 7, 5, 8, 3))
    directions = uniform(7).tolist()
    dataset = make_dataset(tmp_path / "a.nacre", samples, light=directions, view=directions)
    write_btf(dataset, tmp_path / "a.btf", components=20, colour_model=colour_model)
    back = import_dataset(tmp_path / "a.btf", tmp_path / "b.nacre")
    independent = extractor.Ubo2014(str(tmp_path / "a.btf"))
    for light, view in ((0, 0), (3, 5), (6, 2)):
        image = independent._angleindex_to_image_unsafe(light, view)
        # Its images are BGR, top row first; it clamps the model 11, and is 3e-5 off there.
        ours = np.asarray(back.samples[light, view], np.float32)
        expected = ours.clip(0, 1) if colour_model == 11 else ours
        np.testing.assert_allclose(image[::-1, :, ::-1], expected, rtol=2e-3, atol=1e-4)
    assert len(independent.angles_set) == 49
