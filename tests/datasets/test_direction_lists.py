import numpy as np
import pytest

from addon.datasets.directions import read_directions_csv, spherical_to_unit, unit_to_spherical
from addon.errors import NacreError


def test_the_frame_is_x_tangent_y_bitangent_z_normal():
    units = spherical_to_unit([0, 90, 90, 45], [0, 0, 90, 180])
    half = np.sqrt(0.5)
    expected = [[0, 0, 1], [1, 0, 0], [0, 1, 0], [-half, 0, half]]
    np.testing.assert_allclose(units, expected, atol=1e-15)


def test_angles_come_back():
    theta = np.array([0.0, 1e-6, 15, 75, 90])
    phi = np.array([0.0, 359.999, 345, 180, 270])
    back_theta, back_phi = unit_to_spherical(spherical_to_unit(theta, phi))
    np.testing.assert_allclose(back_theta, theta, atol=1e-12)
    np.testing.assert_allclose(back_phi, phi, atol=1e-7)


def test_azimuth_lies_below_360():
    _, phi = unit_to_spherical([[1, -1e-300, 0], [1, -1e-17, 0], [0, 0, 1]])
    assert (phi == 0).all()


def test_csv_is_read_with_spaces_blank_lines_and_byte_order_mark(tmp_path):
    path = tmp_path / "lights.csv"
    path.write_bytes(b"\xef\xbb\xbfTheta, Phi\r\n0,0\r\n\r\n 45 , 180 \r\n")
    np.testing.assert_allclose(read_directions_csv(path), spherical_to_unit([0, 45], [0, 180]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1: expected the header theta,phi"),
        ("phi,theta\n0,0\n", "line 1: expected the header theta,phi"),
        ("theta,phi\n", "holds no directions"),
        ("theta,phi\n0,0\n\n1,2,3\n", "line 4: expected two numbers"),
        ("theta,phi\n0,0\nten,0\n", "line 3: expected two numbers"),
        ("theta,phi\n0,nan\n", "line 2: the angles must be finite"),
        ("theta,phi\n91,0\n", "line 2: theta 91 points below the surface"),
    ],
)
def test_a_wrong_csv_is_named_with_its_line(tmp_path, text, says):
    path = tmp_path / "lights.csv"
    path.write_text(text)
    with pytest.raises(NacreError, match=says):
        read_directions_csv(path)


def test_a_csv_that_is_absent_or_no_text_is_an_error(tmp_path):
    with pytest.raises(NacreError, match="cannot read"):
        read_directions_csv(tmp_path / "absent.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(NacreError, match="not a CSV text file"):
        read_directions_csv(tmp_path / "binary.csv")
