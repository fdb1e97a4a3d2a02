"""The container of RGL's and KAIST's files: what is read, and what is refused where."""

import struct

import numpy as np
import pytest
from brdf_files import TYPES, tensor_file

from addon.datasets.brdf.tensor_file import MAGIC, open_tensor_file
from addon.errors import NacreError


@pytest.fixture
def write(tmp_path):
    def write(data):
        path = tmp_path / "a.bsdf"
        path.write_bytes(data)
        return path

    return write


def refusal(path):
    with pytest.raises(NacreError) as caught:
        open_tensor_file(path)
    text = str(caught.value)
    assert "\n" not in text
    assert "a.bsdf" in text
    return text


@pytest.mark.parametrize("dtype", TYPES)
def test_elements_of_every_type(write, dtype):
    values = np.arange(24).reshape(2, 3, 4).astype(f"<{dtype}")
    file = open_tensor_file(write(tensor_file({"first": np.zeros(3, "u1"), "a": values})))
    field = file.field("a", dtype, 3)
    for found in (file.read(field), file.map(field)):
        assert found.dtype == values.dtype
        assert np.array_equal(found, values)
    assert file.read(field).flags.writeable


def test_empty_and_shared_elements(write):
    """The two axes of a real file are of length 0, and lie where others do."""
    values = np.arange(6, dtype="<f4")
    data = tensor_file({"a": values, "b": np.zeros((0, 9), "<f4")})
    at = data.index(b"\1\0b") + 3 + 2 + 1
    file = open_tensor_file(write(data))
    offset = struct.pack("<Q", file.fields["a"].offset)
    shared = open_tensor_file(write(data[:at] + offset + data[at + 8 :]))
    empty = shared.field("b", "f4", 2)
    assert shared.read(empty).shape == (0, 9)
    assert shared.read(shared.reshaped(empty, (6,))).tolist() == values.tolist()
    with pytest.raises(NacreError, match="the field b needs 36 bytes"):
        shared.reshaped(empty, (9,))


def test_what_is_no_tensor_file_of_version_1_0(write):
    assert "it starts with 'hello'" in refusal(write(b"hello"))
    assert "it starts with ''" in refusal(write(b""))
    assert "version 2.7; 1.0 is" in refusal(write(MAGIC[:-2] + b"\2\7" + bytes(4)))


def test_a_file_cut_short_anywhere(write):
    data = tensor_file({"a": np.arange(6.0), "b": np.ones((2, 2), "u1")})
    for length in range(len(data)):
        refusal(write(data[:length]))
    open_tensor_file(write(data))


def test_claims_beyond_the_file_are_refused_before_anything_is_read(write):
    data = tensor_file({"a": np.arange(6.0)})
    count = len(MAGIC)
    claims = data[:count] + struct.pack("<I", 2**32 - 1) + data[count + 4 :]
    assert "claims 4294967295 fields" in refusal(write(claims))
    empty = tensor_file({"a": np.zeros(0)})
    claims = empty[:count] + struct.pack("<I", 900) + empty[count + 4 :]
    assert "cut short or damaged: it ends in field 2's name" in refusal(write(claims))
    huge = tensor_file({"a": np.arange(6.0)}, {"a": (2**62, 2**62)})
    assert "the field a needs" in refusal(write(huge))
    many = tensor_file({"a": np.arange(6.0)}, {"a": (1,) * 17})
    assert "the field a has 17 axes" in refusal(write(many))
    kind = data.index(b"\1\0a") + 3 + 2
    assert "element type 12" in refusal(write(data[:kind] + b"\x0c" + data[kind + 1 :]))


def test_names_are_text_and_differ(write):
    data = tensor_file({"aa": np.zeros(1), "ab": np.zeros(1)})
    assert "two fields aa" in refusal(write(data.replace(b"ab", b"aa")))
    assert "field 2 has a name that is no text" in refusal(write(data.replace(b"ab", b"a\n")))
    assert "field 1 has a name that is no text" in refusal(write(data.replace(b"aa", b"\xff\xff")))


def test_a_field_that_is_not_what_is_needed(write):
    file = open_tensor_file(write(tensor_file({"a": np.zeros((2, 3), "<f4")})))
    with pytest.raises(NacreError, match="a.bsdf has no field b; its fields: a"):
        file.field("b", "f4", 2)
    for dtype, axes in (("f8", 2), ("f4", 1)):
        with pytest.raises(NacreError, match=r"the field a holds float32 of shape \(2, 3\)"):
            file.field("a", dtype, axes)
