"""`make demo`: a measured weave compressed and shown on a cloth by EEVEE and by Cycles."""

from __future__ import annotations

import time
from pathlib import Path

import bpy
import numpy as np
from PIL import Image

from addon.cli import Progress
from addon.datasets.importing import import_dataset
from addon.datasets.quality import compare_blocks
from addon.models.exr import load_model, save_model
from addon.models.fit import quality_settings
from addon.models.lightness import compress_by_lightness
from addon.nodes.material import material_from_tables
from addon.render.engines import render_to, set_engine
from addon.render.pictures import object_scene
from addon.tables.tables import build_tables

ROOT = Path(__file__).parent.parent
SAMPLE = ROOT / "samples" / "wool_W64xH64_L81xV81.btf"
OUT = ROOT / "out" / "demo"
SIZE = (512, 384)
SAMPLES = {"eevee": 16, "cycles": 16}
LIGHT, VIEW = (50.0, 350.0), (38.0, 290.0)
AMPLIFIED = 8


def main() -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    with Progress() as progress:
        say("Reading", SAMPLE.name)
        dataset = import_dataset(SAMPLE, OUT / "wool.nacre", progress=progress)
        say("Compressing", f"{dataset.raw_bytes / 1e6:.0f} MB by K-CTA")
        settings = quality_settings(dataset, "kcta")
        model = compress_by_lightness(dataset, "kcta", folder=OUT, **settings, progress=progress)
        path = OUT / "wool.exr"
        save_model(model, path)
        model = load_model(path)
        say("Building", "tables and node groups")
        bpy.ops.wm.read_factory_settings(use_empty=True)
        material = material_from_tables(build_tables(model, progress=progress), "wool")
    seconds = render_pictures(material)
    pictures = {engine: read(engine) for engine in SAMPLES}
    difference = compare_blocks([(pictures["cycles"], pictures["eevee"])], peak=1.0)
    write_side_by_side(pictures)
    size = path.stat().st_size
    snr, psnr = model.fit["snr_db"], difference["psnr_db"]
    rows = [
        ("raw size", f"{dataset.raw_bytes / 1e6:.1f} MB"),
        ("compressed size", f"{size / 1e6:.3f} MB"),
        ("compression ratio", f"{dataset.raw_bytes / size:.0f} : 1"),
        ("SNR", f"{snr:.2f} dB"),
        ("fitting", f"{model.fit['seconds']:.1f} s"),
        *((f"rendering with {engine}", f"{taken:.1f} s") for engine, taken in seconds.items()),
        ("PSNR between engines", "equal" if psnr is None else f"{psnr:.1f} dB"),
    ]
    table = "\n".join(f"{name:<24} {value:>12}" for name, value in rows)
    (OUT / "summary.txt").write_text(table + "\n", encoding="utf-8")
    print(
        f"\n{table}\n\nLook at {OUT.relative_to(ROOT)}/side_by_side.png, and open demo.blend there."
    )


def render_pictures(material: bpy.types.Material) -> dict[str, float]:
    """Render with each engine, save the scene as a .blend, and return the seconds taken."""
    seconds = {}
    with object_scene(material, "cloth", SIZE, "cycles", LIGHT, VIEW) as scene:
        for engine, samples in SAMPLES.items():
            say("Rendering", f"with {engine}")
            set_engine(scene, engine, samples)
            started = time.monotonic()
            render_to(scene, OUT / f"{engine}.png")
            seconds[engine] = time.monotonic() - started
        set_engine(scene, "eevee", SAMPLES["eevee"])
        bpy.context.window.scene = scene
        bpy.ops.wm.save_as_mainfile(filepath=str(OUT / "demo.blend"), copy=True, compress=True)
        bpy.context.window.scene = next(other for other in bpy.data.scenes if other != scene)
    return seconds


def read(engine: str) -> np.ndarray:
    with Image.open(OUT / f"{engine}.png") as image:
        return np.asarray(image.convert("RGB"), np.float64) / 255.0


def write_side_by_side(pictures: dict[str, np.ndarray]) -> None:
    """EEVEE, Cycles and their difference, made brighter."""
    difference = np.abs(pictures["eevee"] - pictures["cycles"]) * AMPLIFIED
    row = np.hstack([pictures["eevee"], pictures["cycles"], np.minimum(difference, 1.0)])
    Image.fromarray(np.round(row * 255.0).astype(np.uint8)).save(OUT / "side_by_side.png")


def say(what: str, about: str) -> None:
    print(f"{what:<12} {about}", flush=True)


if __name__ == "__main__":
    main()
