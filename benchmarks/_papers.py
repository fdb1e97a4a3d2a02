"""What the tensor papers print, and their settings carried over to our materials.

Sizes in MB of 2^20 bytes, S/E ratio and SNR in dB, times in minutes on their machines.
"""

from __future__ import annotations

from dataclasses import dataclass

from addon.datasets.dataset import Dataset

from ._methods import Settings


@dataclass(frozen=True)
class KctaColumn:
    """One material of Table I of Tsai and Shih 2012; triples are N-SVD, CTA and K-CTA.

    shape (light, view, x, y); ranks (light, view of N-SVD, view of a cluster, x and y).
    """

    shape: tuple[int, int, int, int]
    ranks: tuple[int, int, int, int]
    clusters: int
    mb: tuple[float, float, float]
    db: tuple[float, float, float]
    minutes: tuple[float, float, float]
    mixtures: int = 3


KCTA = {
    "Corduroy": KctaColumn(
        (81, 81, 128, 128), (20, 32, 4, 80), 8,
        (7.87, 8.13, 8.14), (19.38, 18.2, 19.09), (19.5, 30.43, 54.25),
    ),
    # The sizes of Fiber and RoughHole hold their occlusion textures too.
    "Fiber": KctaColumn(
        (100, 100, 96, 96), (16, 80, 4, 64), 20,
        (11.07, 12.06, 12.09), (17.34, 16.45, 17.29), (8.58, 15.14, 30.86),
    ),
    "RoughHole": KctaColumn(
        (100, 100, 96, 96), (28, 44, 4, 96), 11,
        (22.26, 22.54, 22.56), (14.77, 12.71, 14.54), (2.45, 8.61, 11.74),
    ),
    "Sponge": KctaColumn(
        (120, 90, 128, 128), (16, 20, 4, 80), 5,
        (3.96, 4.11, 4.11), (24.32, 23.55, 24.23), (13.37, 17.61, 18.14),
    ),
    "Wool": KctaColumn(
        (81, 81, 128, 128), (20, 28, 4, 64), 7,
        (4.42, 4.6, 4.6), (20.7, 19.76, 20.52), (8.23, 8.86, 12.66),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class MkctaColumn:
    """One material of Table I of Tsai 2015.

    Quadruples are N-SVD at MK-CTA's rendering rate, N-SVD of its size, K-CTA and MK-CTA.
    angular holds their ranks (light, view), spatial the rank of x and of y.
    """

    shape: tuple[int, int, int, int]
    angular: tuple[tuple[int, int], tuple[int, int], tuple[int, int], tuple[int, int]]
    spatial: int
    clusters: tuple[int, int]
    mb: tuple[float, float, float, float]
    db: tuple[float, float, float, float]
    minutes: tuple[float, float, float, float]
    mixtures: tuple[int, int] = (3, 3)


MKCTA = {
    "Hole": MkctaColumn(
        (81, 81, 128, 128), ((24, 24), (32, 40), (32, 4), (4, 4)), 80, (8, 10),
        (7.09, 15.69, 16.03, 15.73), (19.39, 24.33, 22.82, 24.34), (3.25, 3.32, 32.92, 50.95),
    ),
    "Lego": MkctaColumn(
        (120, 90, 128, 128), ((20, 24), (32, 48), (32, 4), (4, 4)), 64, (8, 12),
        (3.8, 12.06, 12.4, 12.15), (13.36, 17.23, 17.03, 21.69), (26.92, 33.17, 115.23, 142.95),
    ),
}  # fmt: skip

_KCTA_LIKE = {
    "wool": "Wool",
    "weave": "Corduroy",
    "fibre": "Fiber",
    "roughhole": "RoughHole",
    "satin": "Sponge",
}
_LEGO_LIKE = ("studs", "lacquer")


def like_kcta(material: str) -> str:
    """The material of the K-CTA paper whose settings ours takes."""
    return _KCTA_LIKE.get(material, "Corduroy")


def like_mkcta(material: str) -> str:
    """The BTF of the MK-CTA paper whose settings ours takes."""
    return "Lego" if material in _LEGO_LIKE else "Hole"


def kcta_settings(dataset: Dataset, paper: KctaColumn) -> tuple[Settings, Settings, Settings]:
    """N-SVD, CTA and K-CTA as in the paper, the ranks of x and y in proportion to the texels."""
    light, whole, view, spatial = paper.ranks
    y, x = _spatial(dataset, spatial / paper.shape[2])
    whole = min(whole, dataset.shape[1])
    return (
        Settings((light, whole, y, x)),
        Settings((light, view, y, x), (1, paper.clusters)),
        Settings((light, view, y, x), (1, paper.clusters), (1, paper.mixtures)),
    )


def mkcta_settings(
    dataset: Dataset, paper: MkctaColumn
) -> tuple[Settings, Settings, Settings, Settings]:
    """N-SVD twice, K-CTA and MK-CTA as in the paper, x and y in proportion to the texels."""
    fast, same, kcta, mkcta = (
        (*angular, *_spatial(dataset, paper.spatial / paper.shape[2])) for angular in paper.angular
    )
    light, view = paper.clusters
    return (
        Settings(fast),
        Settings(same),
        Settings(kcta, (1, view), (1, paper.mixtures[1])),
        Settings(mkcta, (light, view), paper.mixtures),
    )


def _spatial(dataset: Dataset, share: float) -> tuple[int, int]:
    """Ranks of (y, x): multiples of 4, as K-CTA Section 6 advises."""
    height, width = dataset.shape[2:4]
    return (
        min(height, max(4, 4 * round(height * share / 4))),
        min(width, max(4, 4 * round(width * share / 4))),
    )
