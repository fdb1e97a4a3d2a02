"""Tensor files of the RGL database, and polarimetric ones."""

from brdf_files import PolarisedFile, RglFile

SUFFIX = ".bsdf"

_SMALL = {"thetas": 2, "phis": 3, "size": 2, "warp": (2, 3)}


def seeds() -> dict[str, bytes]:
    return {
        "isotropic": RglFile(0, **_SMALL).to_bytes(),
        "anisotropic": RglFile(1, jacobian=False, **_SMALL).to_bytes(),
        "half": RglFile(2, **_SMALL).to_bytes(),
        "spectra": RglFile(4, (450.0, 550.0, 650.0), **_SMALL).to_bytes(),
        "polarimetric": PolarisedFile((3, 2, 2), (450, 550)).to_bytes(),
    }
