"""What importing does whatever the format: progress, cancelling, damage, full disks."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import numpy as np
import pytest
from btf_writer import BtfFile
from hypothesis import given, settings
from hypothesis import strategies as st
from image_zips import usual_files, write_zip

from addon.datasets.importing import READERS, describe_source, detect_format, import_dataset
from addon.errors import Cancelled, NacreError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(params=["cloth.btf", "cloth.zip"])
def source(request, tmp_path):
    path = tmp_path / request.param
    if path.suffix == ".zip":
        return write_zip(path, usual_files())
    path.write_bytes(BtfFile().to_bytes())
    return path


def test_progress_rises_to_one_and_names_the_file(source, tmp_path):
    calls = []
    import_dataset(
        source, tmp_path / "a.nacre", progress=lambda done, text: calls.append((done, text)) or True
    )
    fractions = [done for done, _ in calls]
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert fractions == sorted(fractions)
    assert len(calls) > 3
    assert all(source.name in text for _, text in calls)


@pytest.mark.parametrize("after", [0, 1, 3])
def test_cancelling_leaves_nothing_new(source, tmp_path, after):
    calls = []

    def stop(done, text):
        calls.append(done)
        return len(calls) <= after

    with pytest.raises(Cancelled):
        import_dataset(source, tmp_path / "a.nacre", progress=stop)
    assert len(calls) == after + 1
    assert os.listdir(tmp_path) == [source.name]


def test_cancelling_leaves_an_older_dataset_alone(source, tmp_path):
    import_dataset(source, tmp_path / "a.nacre")
    before = (tmp_path / "a.nacre" / "samples.npy").read_bytes()
    with pytest.raises(Cancelled):
        import_dataset(source, tmp_path / "a.nacre", progress=lambda done, text: done < 0.5)
    assert (tmp_path / "a.nacre" / "samples.npy").read_bytes() == before
    assert sorted(os.listdir(tmp_path)) == ["a.nacre", source.name]


def test_an_interrupt_leaves_nothing(source, tmp_path):
    def interrupt(done, text):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_dataset(source, tmp_path / "a.nacre", progress=interrupt)
    assert os.listdir(tmp_path) == [source.name]


def test_importing_twice_gives_the_same_bytes(source, tmp_path):
    for name in ("a.nacre", "b.nacre"):
        import_dataset(source, tmp_path / name)
    for file in ("samples.npy", "dataset.json"):
        first, second = ((tmp_path / name / file).read_bytes() for name in ("a.nacre", "b.nacre"))
        assert first == second


def test_the_summary_is_json(source):
    summary = describe_source(source)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert set(summary) - {"layout"} == {
        "format", "light", "view", "width", "height", "channels", "colour_model", "cosine_flag",
        "components", "bytes", "samples_bytes", "memory_bytes", "conversions",
    }  # fmt: skip


def test_formats_are_found_and_named(source, tmp_path):
    name = detect_format(source)
    assert name in READERS
    assert import_dataset(source, tmp_path / "a.nacre", format=name).source["format"] == name
    known = ", ".join(READERS)
    with pytest.raises(NacreError, match=f"there is no format cloth: choose from {known}"):
        import_dataset(source, tmp_path / "b.nacre", format="cloth")
    other = next(other for other in READERS if other != name)
    with pytest.raises(NacreError, match="is not a|holds no"):
        import_dataset(source, tmp_path / "b.nacre", format=other)
    with pytest.raises(NacreError, match="cosine must be 0 or 1"):
        import_dataset(source, tmp_path / "b.nacre", cosine=2)
    with pytest.raises(NacreError, match="already: it needs no import"):
        import_dataset(tmp_path / "a.nacre", tmp_path / "b.nacre")
    assert sorted(os.listdir(tmp_path)) == ["a.nacre", source.name]


def test_a_source_that_is_absent_or_unknown(tmp_path):
    (tmp_path / "cloth.png").write_bytes(b"hello")
    (tmp_path / "empty").mkdir()
    for name in ("absent.btf", "absent.zip"):
        for format in (None, "btf", "ubo2003"):
            with pytest.raises(NacreError, match="there is no file"):
                import_dataset(tmp_path / name, tmp_path / "a.nacre", format=format)
    for name in ("cloth.png", "empty"):
        with pytest.raises(NacreError, match="is of no known format"):
            import_dataset(tmp_path / name, tmp_path / "a.nacre")
    (tmp_path / "folder.btf").mkdir()
    with pytest.raises(NacreError, match="cannot read .*: Is a directory"):
        import_dataset(tmp_path / "folder.btf", tmp_path / "a.nacre")
    assert sorted(os.listdir(tmp_path)) == ["cloth.png", "empty", "folder.btf"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs a file-size limit")
def test_a_disk_that_fills_up_while_importing(tmp_path):
    directions = tuple((0.1 * i, 0.5 * i) for i in range(12))
    file = BtfFile(light=directions, view=directions, width=32, height=32)
    (tmp_path / "cloth.btf").write_bytes(file.to_bytes())
    script = f"""
        import resource, sys
        from addon.datasets.importing import import_dataset
        from addon.errors import NacreError
        resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))
        try:
            import_dataset({str(tmp_path / "cloth.btf")!r}, {str(tmp_path / "a.nacre")!r})
        except NacreError as error:
            sys.exit(str(error))
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], cwd=ROOT, capture_output=True, text=True
    )
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "no room to write" in run.stderr
    assert "a.nacre (1.8 MB): free space or choose another disk" in run.stderr
    assert os.listdir(tmp_path) == ["cloth.btf"]


def test_plain_python_is_enough():
    script = """
        import sys
        import addon.datasets.importing
        assert not {"bpy", "PIL"} & set(sys.modules)
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(script)], cwd=ROOT, check=True)


FILES = {
    "cloth.btf": [
        BtfFile(width=3, height=3).to_bytes(),
        BtfFile(version=4, colour_model=11, scalars=(2, 2, 2), width=2).to_bytes(),
        BtfFile(version=3, xml=b"", transposed=True, colour_model=12, scalars=(8, 4, 2)).to_bytes(),
        BtfFile(signature=b"!DFMF08FC", version=1, colour_model=9).to_bytes(),
    ]
}


def zip_bytes():
    with tempfile.TemporaryDirectory() as folder:
        return [
            write_zip(Path(folder) / "a.zip", usual_files(suffix)).read_bytes()
            for suffix in (".png", ".jpg")
        ]


FILES["cloth.zip"] = zip_bytes()


@st.composite
def damaged(draw, name):
    """A file with some bytes changed, perhaps cut short, perhaps with more at its end."""
    data = bytearray(draw(st.sampled_from(FILES[name])))
    # Most of a file is samples: half of the time, hit the header.
    reach = draw(st.sampled_from([len(data), 500]))
    for _ in range(draw(st.integers(0, 4))):
        position = draw(st.integers(0, reach - 1))
        data[position] = draw(st.sampled_from([0, 1, 255]) | st.integers(0, 255))
    if draw(st.booleans()):
        del data[draw(st.integers(0, len(data))) :]
    return bytes(data) + draw(st.binary(max_size=2))


@pytest.mark.parametrize("name", list(FILES))
@pytest.mark.filterwarnings("error")
@given(data=st.data())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_a_damaged_file_gives_a_dataset_or_one_clear_error(name, data):
    folder = Path(tempfile.mkdtemp())
    try:
        path = folder / name
        path.write_bytes(data.draw(damaged(name)))
        try:
            dataset = import_dataset(path, folder / "a.nacre")
        except NacreError as error:
            assert "\n" not in str(error)
            assert os.listdir(folder) == [name]
        else:
            assert np.isfinite(dataset.samples).all()
            assert sorted(os.listdir(folder)) == ["a.nacre", name]
    finally:
        shutil.rmtree(folder)
