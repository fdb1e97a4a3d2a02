"""Sparse tensor decomposition (Ruiters and Klein 2009) against the tensor models at equal size.

The comparison of Figure 9 of the K-CTA paper: D_1 = D_2 = 256 and two configurations of (k_1, k_2),
one of K-CTA's size and one that reads as few values a texel as K-CTA. The first spends its size on
the codes of views and of positions in several proportions; the best is shown. A third works on
decorrelated logarithmic colours (log Y, U/Y, V/Y, as measured-BTF files do): what it gains in the
dark it loses in linear SNR. Difference images go to out/bench.

`python -m benchmarks.sparse_tensor [FOLDER] [--only NAME ...]`; FOLDER holds rendered datasets.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import log10

import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset

from ._data import OUT, arguments, materials
from ._methods import MIB, Settings, fit
from ._papers import KCTA, MKCTA, kcta_settings, mkcta_settings
from ._plots import difference_images
from ._report import table
from ._sparse_tensor import fit_sparse_tensor, sparse_tensor_bytes

Array = NDArray[np.floating]

ATOMS = (256, 256)
VIEW_SHARES = (0.7, 0.85, 0.95)
"""How much of the codes' bytes goes to the views of the slices."""

DIFFERENCE = 3.0
"""The paper's Figure 3 scales differences by this."""

YUV = np.array(
    [[0.2126, 0.7152, 0.0722], [-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]], np.float32
)
"""Luminance and chroma of linear Rec.709."""

DARK = 1e-2
"""Added to the luminance before its logarithm."""

CHROMA_SHARE = 0.4
"""How much of the size the chroma gets."""


@dataclass(frozen=True)
class Row:
    """A line of the table, and the image (y, x, channel) that it shows."""

    label: str
    settings: str
    mb: float
    snr: float
    seconds: float
    reads: int
    image: Array


@dataclass(frozen=True)
class Coded:
    """Samples (light, view, y, x, channel) after decomposition; bytes, and values read a texel."""

    samples: Array
    bytes: int
    reads: int


def main() -> None:
    options = arguments("sparse_tensor", __doc__)
    print("Sizes in MB of 2^20 bytes; values a texel: read for one light and one view, x and y of")
    print("the tensor models' cores expanded.")
    for name, dataset in materials(options.folder, options.only).items():
        compare(name, dataset)


def compare(name: str, dataset: Dataset) -> None:
    """Print the table of one material and save its images."""
    place = _shown(dataset)
    nsvd, _, kcta = kcta_settings(dataset, KCTA["Wool"])
    mkcta = _of_size(dataset, kcta, mkcta_settings(dataset, MKCTA["Hole"])[3])
    rows = [_tensor_model(dataset, settings, place) for settings in (nsvd, kcta, mkcta)]
    samples = np.asarray(dataset.samples, np.float32)
    size = 2 * kcta.count(dataset.shape)
    tried = [
        _linear("STD", samples, _sparsity(samples.shape, size, share), place)
        for share in VIEW_SHARES
    ]
    # It reads k_2 (1 + k_1 (1 + channels)) values.
    entries = max(1, round((rows[1].reads / (1 + samples.shape[-1])) ** 0.5))
    rows.append(max(tried, key=lambda row: row.snr))
    rows.append(_linear("STD, as fast", samples, (entries, entries), place))
    rows.append(_logarithmic("STD, log", samples, size, place))
    print(f"\n{name} {'x'.join(map(str, dataset.shape[:4]))}")
    header = ["", "settings", "MB", "SNR (dB)", "time", "values a texel"]
    print(table([header, *(_cells(row) for row in rows)]))
    others = "; ".join(f"{row.settings}: {row.snr:.2f} dB" for row in tried)
    print(f"  STD at K-CTA's size in other proportions: {others}")
    difference_images(
        OUT / f"sparse_tensor_{name}.png",
        samples[place],
        [(f"{row.label}\n{row.mb:.2f} MB, {row.snr:.2f} dB", row.image) for row in rows],
        title=f"{name}: one light, one view",
        factor=DIFFERENCE,
    )


def _cells(row: Row) -> list[str]:
    return [
        row.label,
        row.settings,
        f"{row.mb:.2f}",
        f"{row.snr:.2f}",
        f"{row.seconds:.0f} s",
        str(row.reads),
    ]


def _shown(dataset: Dataset) -> tuple[int, int]:
    """A light some 40 degrees off the normal and the view nearest to its mirror direction."""
    light = int(np.argmin(np.abs(dataset.light[:, 2] - np.cos(np.radians(40)))))
    mirrored = dataset.light[light] * (-1, -1, 1)
    return light, int(np.argmax(dataset.view @ mirrored))


def _of_size(dataset: Dataset, kcta: Settings, mkcta: Settings) -> Settings:
    """MK-CTA with K-CTA's ranks of x and y and as many view clusters as fit in its size."""
    lights, mixtures = mkcta.clusters[0], mkcta.mixtures
    ranks = (*mkcta.ranks[:2], *kcta.ranks[2:])
    counts = range(mixtures[1], dataset.shape[1] + 1)
    fitting = [
        settings
        for settings in (Settings(ranks, (lights, count), mixtures) for count in counts)
        if settings.count(dataset.shape) <= kcta.count(dataset.shape)
    ]
    return fitting[-1]


def _tensor_model(dataset: Dataset, settings: Settings, place: tuple[int, int]) -> Row:
    found = fit(dataset, settings)
    light, view = place
    label = {"nsvd": "N-SVD", "kcta": "K-CTA", "mkcta": "MK-CTA"}[settings.method]
    text = "R " + "x".join(map(str, settings.ranks))
    if settings.method != "nsvd":
        text += ", C {}x{}".format(*settings.clusters) + ", K {}x{}".format(*settings.mixtures)
    return Row(
        label,
        text,
        found.mb,
        found.snr,
        found.seconds,
        _reads(settings, dataset.shape[4]),
        found.model.decode(light=[light], view=[view])[0, 0],
    )


def _reads(settings: Settings, channels: int) -> int:
    """Values of the core and of the light and view bases that one texel needs."""
    light, view = settings.ranks[:2]
    light_mixtures, view_mixtures = settings.mixtures
    cores = light_mixtures * view_mixtures
    if settings.method == "mkcta":  # a basis for each of the other mode's clusters
        return cores * (light * view + channels * light + view)
    return cores * light * view + channels * light + view_mixtures * view


def _linear(label: str, samples: Array, sparsity: tuple[int, int], place: tuple[int, int]) -> Row:
    """Sparse tensor decomposition of linear colours, which share their codes."""
    started = time.monotonic()
    coded = _coded(samples, sparsity)
    return Row(
        label,
        f"k {sparsity[0]}, {sparsity[1]}",
        coded.bytes / MIB,
        _snr(samples, coded.samples),
        time.monotonic() - started,
        coded.reads,
        coded.samples[place],
    )


def _logarithmic(label: str, samples: Array, size: int, place: tuple[int, int]) -> Row:
    """The same of log Y and of U/Y and V/Y, each with codes of its own."""
    started = time.monotonic()
    yuv = samples @ YUV.T
    luminance = np.maximum(yuv[..., :1], 0.0) + DARK
    parts = (np.log(luminance), yuv[..., 1:] / luminance)
    sizes = (round((1 - CHROMA_SHARE) * size), round(CHROMA_SHARE * size))
    sparsity = [
        _sparsity(part.shape, share, VIEW_SHARES[0])
        for part, share in zip(parts, sizes, strict=True)
    ]
    first, second = (_coded(part, k) for part, k in zip(parts, sparsity, strict=True))
    luminance = np.exp(first.samples)
    yuv = np.concatenate([luminance - DARK, second.samples * luminance], axis=-1)
    decoded = yuv @ np.linalg.inv(YUV).T
    return Row(
        label,
        "k " + " and ".join(f"{views}, {positions}" for views, positions in sparsity),
        (first.bytes + second.bytes) / MIB,
        _snr(samples, decoded),
        time.monotonic() - started,
        first.reads + second.reads,
        decoded[place],
    )


def _coded(samples: Array, sparsity: tuple[int, int]) -> Coded:
    """Decompose samples (light, view, y, x, channel), round to half floats and decode."""
    lights, views, height, width, channels = samples.shape
    signals = samples.transpose(2, 3, 0, 4, 1).reshape(height * width, -1)
    found = fit_sparse_tensor(signals, lights * channels, atoms=ATOMS, sparsity=sparsity).half()
    decoded = found.decode().reshape(height, width, lights, channels, views)
    return Coded(
        np.ascontiguousarray(decoded.transpose(2, 4, 0, 1, 3)),
        found.bytes,
        sparsity[1] * (1 + sparsity[0] * (1 + channels)),
    )


def _sparsity(shape: tuple[int, ...], size: float, view_share: float) -> tuple[int, int]:
    """(k_1, k_2) of a decomposition of `size` bytes that gives `view_share` to the views' codes."""
    lights, views, height, width, channels = shape

    def stored(first: int, second: int) -> int:
        return sparse_tensor_bytes(lights * channels, views, height * width, ATOMS, (first, second))

    codes = size - stored(0, 0)
    first = max(1, round(view_share * codes / (stored(1, 0) - stored(0, 0))))
    second = (size - stored(first, 0)) / (stored(0, 1) - stored(0, 0))
    return first, max(1, int(second))


def _snr(samples: Array, decoded: Array) -> float:
    signal = sum(float(np.vdot(row, row)) for row in samples)
    noise = sum(float(np.sum(np.square(a - b))) for a, b in zip(samples, decoded, strict=True))
    return 10.0 * log10(signal / noise)


if __name__ == "__main__":
    main()
