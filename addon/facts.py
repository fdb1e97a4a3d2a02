"""What a file is, for people: lines of a name and a value, cheap to draw and to keep."""

import math
import os
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from .datasets.dataset import Dataset, open_dataset
from .datasets.importing import READERS, describe_source, detect_format
from .errors import NacreError

METHODS = {
    "nsvd": "N-SVD",
    "cta": "CTA",
    "kcta": "K-CTA",
    "mkcta": "MK-CTA",
    "sparse": "SparseBTF",
}


def parse_facts(facts: str) -> list[tuple[str, str]]:
    """The (name, value) pairs of a text that this module made; a problem has no name."""
    return [(name, value) for name, _, value in (row.partition("\t") for row in facts.split("\n"))]


def dataset_facts(path: str) -> str:
    """Directions, texels and size of a dataset folder, or what is wrong with it."""

    def describe() -> dict[str, str]:
        dataset = open_dataset(path)
        sizes = dataset.sizes
        floor = dataset.noise_floor_db
        return {
            "Name": dataset.path.name,
            "Directions": _directions(sizes),
            "Texels": f"{sizes['x']} × {sizes['y']}",
            "Size": size_text(dataset.samples.nbytes),
            **({"Noise Floor": f"{floor:.1f} dB"} if floor is not None else {}),
        }

    return _facts(describe, path)


def model_facts(path: str) -> str:
    """Method, size, ratio and SNR of a model file, or what is wrong with it."""

    def describe() -> dict[str, str]:
        from .models.any_model import load_any, quality_of_model

        model = load_any(path)
        size = os.path.getsize(path)
        method = METHODS.get(str(model.fit.get("method")), "Clustered Tucker")
        quality = quality_of_model(model)
        rows = {
            "Name": os.path.basename(path),
            "Method": f"{method}({quality})" if quality else method,
            "Size": f"{size_text(size)} (1 : {round(4 * math.prod(model.shape) / size)})",
        }
        if "snr_db" in model.fit:
            rows["SNR"] = f"{model.fit['snr_db']:.1f} dB"
        return rows

    return _facts(describe, path)


def ensemble_facts(dataset: str, path: str, quality: int) -> str:
    """What dictionaries a dataset would be coded in, those of `path` or Nacre's own, and the size;
    or why they do not fit it."""

    def describe() -> dict[str, str]:
        from .models.sparse.ensemble import choose
        from .models.sparse.files import ensembles_of

        btf = open_dataset(dataset)
        ensemble = choose(ensembles_of([path] if path else []), btf)
        dictionaries = ensemble.dictionaries
        counts = ", ".join(f"{len(modes[0])} for {key}" for key, modes in dictionaries.items())
        halves = sum(matrices.size for modes in dictionaries.values() for matrices in modes)
        halves += 2 * btf.sizes["light"] * btf.sizes["view"]
        size = 2 * halves + 2 * quality * btf.sizes["y"] * btf.sizes["x"]
        return {
            "Dictionaries": counts,
            "Patches": " × ".join(str(side) for side in reversed(ensemble.patch)),
            "Size": f"up to {size_text(size)} (1 : {round(btf.raw_bytes / size)})",
        }

    return _facts(describe, path or dataset)


def source_facts(path: str, **given: Any) -> str:
    """What importing a measured file would give, or what is wrong with it; cached by its date.

    `given` are fields of Options.
    """
    state = _state(path, given.get("directions"))
    return _source_facts(path, tuple(sorted(given.items())), state) if state else ""


def source_takes(path: str, directions: str = "") -> frozenset[str]:
    """The names of the Options that a measured file's format takes; cached by its date."""
    state = _state(path, directions)
    return _source_takes(path, directions, state) if state else frozenset()


def _state(*paths: str | None) -> tuple[tuple[int, int], ...]:
    """Times and sizes of files, that change when the files do; nothing when the first is absent."""
    found = []
    for path in paths:
        try:
            status = os.stat(path or "")
            found.append((status.st_mtime_ns, status.st_size))
        except OSError:
            if not found:
                return ()
    return tuple(found)


@lru_cache(maxsize=64)
def _source_takes(path: str, directions: str, _state: object) -> frozenset[str]:
    try:
        return READERS[detect_format(path, directions or None)].OPTIONS
    except (NacreError, ImportError, OSError):
        return frozenset()


@lru_cache(maxsize=64)
def _source_facts(path: str, given: tuple[tuple[str, Any], ...], _state: object) -> str:
    def describe() -> dict[str, str]:
        source = describe_source(path, **dict(given))
        samples = source["samples_bytes"]
        return {
            "Directions": _directions(source),
            "Texels": f"{source['width']} × {source['height']}",
            "File": size_text(source["bytes"]),
            "On Disk": size_text(samples),
            "Memory": f"about {size_text(source['memory_bytes'])}",
        }

    return _facts(describe, path)


def expected_model(dataset: Dataset, method: str, settings: dict[str, dict[str, int]]) -> str:
    """What `compress` with these settings would save at most: half floats for core and bases, a
    number for each item's clusters.
    """
    from .models.fit import mode_sizes, usual_global_modes

    rows, ranks = mode_sizes(dataset), settings["ranks"]
    clusters, mixtures = settings.get("clusters", {}), settings.get("mixtures", {})
    every = math.prod(clusters.values())
    shared = usual_global_modes(method, rows, clusters)
    halves = every * math.prod(ranks.values())
    members = 0
    for mode in rows:
        owners = 1 if mode in shared else every // clusters.get(mode, 1)
        halves += owners * rows[mode] * mixtures.get(mode, 1) * ranks[mode]
        members += rows[mode] * mixtures.get(mode, 0)
    size = 2 * halves + 4 * members
    return f"up to {size_text(size)} (1 : {round(dataset.raw_bytes / size)})"


def size_text(size: float) -> str:
    """Bytes with three digits: 0.33 MB, 161 MB, 2.41 GB (of 10^9 bytes)."""
    if size >= 1e9:
        return f"{size / 1e9:#.3g} GB".replace(". ", " ")  # 161. MB
    if size >= 1e6:
        return f"{size / 1e6:#.3g} MB".replace(". ", " ")
    return f"{max(size, 1) / 1e3:.0f} kB"


def _directions(sizes: Mapping[str, Any]) -> str:
    """81 lights × 81 views; of occlusion the views alone."""
    return " × ".join(f"{sizes[axis]} {axis}s" for axis in ("light", "view") if axis in sizes)


def _facts(describe: Callable[[], dict[str, str]], path: str) -> str:
    """Rows as one text; a NacreError, or a missing package, as one row without a name."""
    if not path:
        return ""
    try:
        rows = describe()
    except (NacreError, ImportError, OSError) as error:
        # The path is on display already, and a panel is narrow.
        full = str(Path(path))
        return "\t" + str(error).replace(f"{full}: ", "").replace(full, Path(path).name)
    return "\n".join(f"{name}\t{value}" for name, value in rows.items())
