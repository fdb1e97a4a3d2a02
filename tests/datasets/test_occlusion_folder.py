"""Datasets of occlusion: other axes than a BTF's, and a value."""

import json

import numpy as np
import pytest
from fibres import describe_occlusion, fibre_masks, views, write_occlusion

from addon.datasets.dataset import DatasetWriter, open_dataset
from addon.errors import NacreError

UP = [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("dtype", "value"), [(np.float16, "mask"), (np.float32, "signed-distance")]
)
def test_what_is_written_is_opened(dtype, value, tmp_path):
    masks = fibre_masks(views(), 16)
    dataset = write_occlusion(tmp_path / "a.nacre", masks, dtype=dtype, value=value)
    assert (dataset.kind, dataset.axes, dataset.value) == ("occlusion", ("view", "y", "x"), value)
    assert dataset.shape == masks.shape
    assert dataset.sizes == {"view": len(masks), "y": 16, "x": 16}
    assert dataset.samples.dtype == dtype
    assert dataset.raw_bytes == 4 * masks.size
    np.testing.assert_array_equal(dataset.samples, masks)
    np.testing.assert_array_equal(dataset.view, views())
    assert dataset.light.shape == (0, 3)
    assert dataset.channels == ()
    written = json.loads((tmp_path / "a.nacre" / "dataset.json").read_text())
    assert written == describe_occlusion(views(), value=value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"value": "distance"}, "value 'distance': expected mask or signed-distance"),
        ({"value": ""}, "value ''"),
        ({"value": ["mask"]}, "value"),
        ({"axes": ["view", "x", "y"]}, "other axes than view, y, x"),
        ({"view": [UP]}, "lists 1 views, but the samples have shape"),
        ({"view": [[0, 0, 2], UP]}, "view directions that are not unit vectors"),
        ({"kind": "btf"}, "lacks channels, light"),
        ({"kind": ["occlusion"]}, "of the kind"),
    ],
)
def test_a_description_that_breaks_the_layout_is_refused(change, says, tmp_path):
    samples = np.ones((2, 3, 4))
    write_occlusion(tmp_path / "a.nacre", samples)
    description = {**describe_occlusion(views()[:2]), **change}
    (tmp_path / "a.nacre" / "dataset.json").write_text(json.dumps(description))
    with pytest.raises(NacreError, match=says):
        open_dataset(tmp_path / "a.nacre")
    with pytest.raises(NacreError, match=says):
        DatasetWriter(tmp_path / "b.nacre", description, samples.shape, np.float16)


def test_a_description_without_a_value_is_refused(tmp_path):
    description = describe_occlusion(views()[:2])
    del description["value"]
    with pytest.raises(NacreError, match="lacks value"):
        DatasetWriter(tmp_path / "a.nacre", description, (2, 3, 4), np.float16)


@pytest.mark.parametrize("shape", [(2, 12), (1, 2, 3, 4, 1), (2, 0, 4), ()])
def test_samples_of_other_axes_are_refused(shape, tmp_path):
    write_occlusion(tmp_path / "a.nacre", np.ones((2, 3, 4)))
    np.save(tmp_path / "a.nacre" / "samples.npy", np.zeros(shape, np.float16))
    with pytest.raises(NacreError, match="shape"):
        open_dataset(tmp_path / "a.nacre")


def test_a_value_that_is_no_number_is_named_with_its_place(tmp_path):
    samples = np.ones((2, 3, 4))
    samples[1, 0, 3] = np.nan
    with pytest.raises(NacreError, match="at view 1, y 0, x 3 is not a finite number"):
        write_occlusion(tmp_path / "a.nacre", samples)
