"""The options of an import: those of the file's format are shown, what is chosen is passed on."""

from dataclasses import fields
from types import SimpleNamespace

import bpy
import pytest
from brdf_files import RglFile, anisotropic, utia_file

from addon.datasets.dataset import open_dataset
from addon.datasets.direction_sets import direction_set
from addon.datasets.importing import READERS
from addon.datasets.options import Options
from addon.errors import Cancelled
from addon.operators import import_btf, import_options


@pytest.fixture
def passed_on(monkeypatch):
    """What the import is called with, instead of importing."""
    seen = []

    def stop(source, destination, *, progress, **options):
        seen.append(options)
        raise Cancelled

    monkeypatch.setattr(import_btf, "import_dataset", stop)
    return seen


@pytest.fixture
def brdf(tmp_path):
    path = tmp_path / "cloth.bsdf"
    path.write_bytes(RglFile().to_bytes())
    return path


class Layout:
    """Notes the properties that are drawn."""

    def __init__(self):
        self.seen = []

    def prop(self, data, name):
        self.seen.append(name)


def shown(takes, **chosen):
    defaults = {"directions": "", "lights": "AUTO", "views": "AUTO", "gamma": "AUTO"}
    layout = Layout()
    operator = SimpleNamespace(**{**defaults, **chosen})
    import_options.ImportOptions.draw_options(operator, layout, frozenset(takes))
    return layout.seen


def test_only_what_the_format_takes_is_shown():
    assert shown([]) == []
    for reader in READERS.values():
        assert set(shown(reader.OPTIONS)) == reader.OPTIONS


def test_every_option_can_be_chosen():
    names = {field.name for field in fields(Options)}
    assert set(shown(names)) == names
    assert {name for reader in READERS.values() for name in reader.OPTIONS} <= names


def test_a_choice_asks_for_its_number():
    assert shown(["gamma"], gamma="POWER") == ["gamma", "gamma_power"]
    assert shown(["lights", "views"], views="UNIFORM") == ["lights", "views", "views_count"]


def test_a_list_stands_for_lights_and_views():
    assert shown(READERS["rgl"].OPTIONS, directions="a.csv") == ["directions", "patch_width"]


def test_nothing_chosen_leaves_it_all_to_the_file(passed_on, sample):
    assert bpy.ops.nacre.import_btf(filepath=str(sample)) == {"CANCELLED"}
    assert passed_on == [{field.name: None for field in fields(Options)}]


@pytest.mark.parametrize(
    ("chosen", "option", "value"),
    [
        ({"gamma": "SRGB"}, "gamma", "srgb"),
        ({"gamma": "LINEAR"}, "gamma", 1.0),
        ({"gamma": "POWER", "gamma_power": 1.8}, "gamma", 1.8),
        ({"gamma_power": 1.8}, "gamma", None),
        ({"colour_space": "XYZ"}, "colour_space", "xyz"),
        ({"colour_space": "REC709"}, "colour_space", "rec709"),
        ({"white": 0.8}, "white", 0.8),
        ({"patch_width": 0.025}, "patch_width", 0.025),
        ({"lights": "UBO151"}, "lights", "ubo151"),
        ({"views": "UNIFORM", "views_count": 12}, "views", "uniform:12"),
        ({"lights_count": 12}, "lights", None),
        ({"directions": "/a/b.csv"}, "directions", "/a/b.csv"),
    ],
)
def test_what_is_chosen_is_passed_on(chosen, option, value, passed_on, sample):
    assert bpy.ops.nacre.import_btf(filepath=str(sample), **chosen) == {"CANCELLED"}
    (options,) = passed_on
    assert options == {field.name: None for field in fields(Options)} | {option: value}


def test_every_set_of_directions_is_one():
    for name in filter(None, import_options.DIRECTIONS.values()):
        assert len(direction_set(name)) > 81
    assert import_options.DIRECTIONS["AUTO"] is None


def test_a_patch_is_a_length():
    patch = bpy.ops.nacre.import_btf.get_rna_type().properties["patch_width"]
    assert (patch.unit, patch.subtype) == ("LENGTH", "DISTANCE")


def test_a_brdf_at_the_directions_that_were_chosen(scene, brdf):
    options = {"lights": "UNIFORM", "lights_count": 7, "views": "UBO151", "patch_width": 0.2}
    assert bpy.ops.nacre.import_btf(filepath=str(brdf), **options) == {"FINISHED"}
    dataset = open_dataset(scene.nacre.dataset)
    assert dataset.shape == (7, 151, 1, 1, 3)
    assert dataset.patch_size == (0.2, 0.2)
    assert "Directions\t7 lights × 151 views" in scene.nacre.dataset_facts


def test_a_list_of_directions_beside_the_file(scene, brdf):
    listed = brdf.with_name("mine.csv")
    listed.write_text("theta,phi\n0,0\n45,90\n")
    options = {"filepath": str(brdf), "directions": str(listed)}
    assert bpy.ops.nacre.import_btf(**options) == {"FINISHED"}
    assert open_dataset(scene.nacre.dataset).shape == (2, 2, 1, 1, 3)


def test_an_encoding_that_was_chosen(scene, tmp_path):
    path = tmp_path / "m001.bin"
    path.write_bytes(utia_file(anisotropic))
    assert bpy.ops.nacre.import_btf(filepath=str(path), gamma="LINEAR") == {"FINISHED"}
    assert (
        "values decoded from gamma 1, as asked"
        in (open_dataset(scene.nacre.dataset).source["conversions"])
    )


def test_a_script_is_told_of_an_option_that_the_format_does_not_take(brdf):
    with pytest.raises(RuntimeError, match="cloth.bsdf is read as rgl, which takes no --gamma"):
        bpy.ops.nacre.import_btf(filepath=str(brdf), gamma="SRGB")


def test_in_the_window_what_is_not_shown_does_not_count(brdf, monkeypatch):
    operator = SimpleNamespace(
        _in_window=True, chosen_options=lambda: {"gamma": "srgb", "lights": "uniform:3"}
    )
    takes = READERS["rgl"].OPTIONS
    options = import_btf.NACRE_OT_import_btf._options(operator, takes)
    assert options == {"lights": "uniform:3"}
    operator._in_window = False
    assert import_btf.NACRE_OT_import_btf._options(operator, takes) == operator.chosen_options()


class Dialog(import_options.ImportOptions):
    """The operator as its dialog draws it."""

    draw = import_btf.NACRE_OT_import_btf.draw
    _takes = import_btf.NACRE_OT_import_btf._takes
    _options = import_btf.NACRE_OT_import_btf._options
    _usual_destination = import_btf.NACRE_OT_import_btf._usual_destination
    _in_window = True
    cosine = gamma = colour_space = lights = views = "AUTO"
    white = patch_width = 0.0
    gamma_power, lights_count, views_count = 2.2, 100, 100
    directions = destination = ""

    def __init__(self, path, **chosen):
        self.filepath, self.layout = str(path), DialogLayout()
        vars(self).update(chosen)

    def shown(self):
        width = SimpleNamespace(width=340)
        scale = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0))
        self.draw(SimpleNamespace(region=width, preferences=scale))
        return self.layout.seen


class DialogLayout(Layout):
    def prop(self, data, name, placeholder=""):
        assert hasattr(data, name), name
        self.seen.append(name)

    def label(self, text="", icon="NONE", translate=True):
        self.seen.append(text)

    def column(self, **_):
        return self

    row = split = column


def test_the_dialog_of_a_brdf_tells_its_size_and_asks_for_directions(brdf):
    shown = Dialog(brdf).shown()
    for pair in ("Directions", "81 lights × 81 views"), ("Texels", "1 × 1"), ("On Disk", "79 kB"):
        assert shown.index(pair[1]) == shown.index(pair[0]) + 1
    assert shown[-5:] == ["directions", "lights", "views", "patch_width", "destination"]
    assert "9 lights × 81 views" in Dialog(brdf, lights="UNIFORM", lights_count=9).shown()


def test_the_dialog_forgets_what_another_file_was_asked(brdf, sample):
    """A gamma chosen for images, before a BRDF was clicked on in the file browser."""
    assert "81 lights × 81 views" in Dialog(brdf, gamma="SRGB").shown()
    assert Dialog(sample, lights="UBO151").shown()[-3:] == ["cosine", "patch_width", "destination"]


def test_the_dialog_before_a_file_is_chosen(tmp_path):
    assert Dialog(tmp_path).shown()[-1] == "destination"
