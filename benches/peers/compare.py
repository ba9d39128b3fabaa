"""Time and error of Pinspot and of Mitsuba 3's particle tracer on the same work, one core each.

The work is the caustic of the built-in scene `ring-above`: one bounce of a tiny sun by a ring onto a table, 512², with
occlusion. Errors are relative, over the pixels that count (not within 15 mm of the ring's wall, nor where it is dark), against
`pinspot reference`: at pixel centres for Pinspot, over pixels for Mitsuba, whose film knows no centres. Mitsuba cannot leave
occlusion out; Pinspot can, and is also held against the ground truth without it.

Mitsuba renders the scene with its integrators as they are. Mirrors are red and all else is grey, so that red minus green
is what the mirror brought. Its sun is a map of the environment that is not rotated (with a rotation `ptracer` of 3.9 is too
bright), and its camera is far away: seen in perspective, a plane stays a plane.
"""

import argparse
import csv
import json
import math
import os
import pathlib
import subprocess
import time

import numpy as np
import OpenEXR

ROOT = pathlib.Path(__file__).resolve().parents[2]
WORK = ROOT / "target" / "peers"
PLOT = ROOT / "benches" / "peers" / "time.svg"
PINSPOT = ROOT / "target" / "release" / "pinspot"
SCENE = "ring-above"
EDGE = 512
# The scene's numbers: src/scene/builtin/ring-above.toml.
TO_SUN = np.array([0.6123724, 0.7071068, -0.3535534])
SIGMA = 0.011284
RADIANCE = 1250.0
TABLE = 3.0
# The stages that run again when a mirror moves; some belong to flat sums only, others to hierarchical ones.
STAGES_AFTER_A_MOVE = (
    "geometry", "bvh", "surface", "points", "differentials", "tree", "visibility", "estimate", "rays", "caustic"
)


def read(path):
    """R, G, B of an OpenEXR image."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return np.stack([channels[c].pixels for c in "RGB"], axis=-1).astype(np.float64)


def pinspot(*arguments):
    """Runs Pinspot on one core; its report."""
    environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
    done = subprocess.run([PINSPOT, *arguments, "--json"], env=environment, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def reference(name, visibility, pixel_samples, relative_error):
    """The ground truth: at pixel centres, or over pixels if there are several samples of each."""
    path = WORK / f"reference-{name}.exr"
    command = [PINSPOT, "reference", SCENE, "--visibility", visibility, "--size", f"{EDGE}x{EDGE}", "--quiet"]
    command += ["--pixel-samples", str(pixel_samples), "--rel-error", str(relative_error), "--output", str(path)]
    subprocess.run(command, check=True)
    return read(path)[..., 1]


def mask_of(truth):
    """Where errors count."""
    at = (np.arange(EDGE) + 0.5) / EDGE * TABLE - 0.5 * TABLE
    radius = np.hypot(*np.meshgrid(at, at))
    return (truth > 0.02 * np.quantile(truth, 0.999)) & (np.abs(radius - 1.0) > 0.015)


def error(image, truth, mask):
    return math.sqrt(((image - truth)[mask] ** 2).sum() / (truth[mask] ** 2).sum())


def run_pinspot(truth, mask, evaluation, samples, leaves, visibility="full", tolerance=0.1):
    """Seconds for all that follows a moving mirror: samples, cells, what they see, the gather. Best of three."""
    path = WORK / "pinspot.exr"
    command = ["render", SCENE, "--size", f"{EDGE}x{EDGE}", "--aov", "caustic", "--visibility", visibility, "--backend", "cpu"]
    command += ["--samples", str(samples), "--evaluation", evaluation, "--leaves", str(leaves), "--output", str(path)]
    if evaluation == "hierarchical":
        command += ["--tolerance", str(tolerance)]
    best = math.inf
    for _ in range(3 if evaluation == "hierarchical" else 1):
        report = pinspot(*command)
        best = min(best, sum(report["seconds"].get(stage, 0.0) for stage in STAGES_AFTER_A_MOVE))
    return report["samples"] * leaves, best, error(read(path)[..., 1], truth, mask)


def sun(width=4096):
    """The sun as Mitsuba's map: rows 0 and height - 1 lie on the poles."""
    height = width // 2
    u = 2.0 * np.pi * (np.arange(width) + 0.5) / width
    v = np.pi * np.arange(height) / (height - 1)
    directions = np.stack(
        [np.sin(v)[:, None] * np.sin(u), np.broadcast_to(np.cos(v)[:, None], (height, width)), -np.sin(v)[:, None] * np.cos(u)],
        axis=-1,
    )
    to_sun = TO_SUN / np.linalg.norm(TO_SUN)
    angle = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(directions - to_sun, axis=-1), 1.0))
    radiance = RADIANCE * np.exp(-0.5 * (angle / SIGMA) ** 2)
    return np.repeat(radiance[..., None], 3, axis=-1).astype(np.float32)


def mitsuba_scene(mi):
    distance = 400.0
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    rotate = mi.ScalarTransform4f().rotate
    return mi.load_dict({
        "type": "scene",
        "sun": {"type": "envmap", "bitmap": mi.Bitmap(sun())},
        "camera": {
            "type": "perspective",
            "fov": math.degrees(2.0 * math.atan(0.5 * TABLE / distance)),
            "near_clip": 1.0,
            "far_clip": 2.0 * distance,
            "to_world": mi.ScalarTransform4f().look_at(origin=[0, distance, 0], target=[0, 0, 0], up=[0, 0, -1]),
            "film": {
                "type": "hdrfilm",
                "width": EDGE,
                "height": EDGE,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
        },
        "ring": {
            "type": "cylinder",
            "p0": [0, 0, 0],
            "p1": [0, 0.5, 0],
            "radius": 1.0,
            "flip_normals": True,
            "material": {"type": "conductor", "material": "none", "specular_reflectance": {"type": "rgb", "value": [1.0, 0.0, 0.0]}},
        },
        "table": {
            "type": "rectangle",
            "to_world": rotate([1, 0, 0], -90) @ mi.ScalarTransform4f().scale(0.5 * TABLE),
            "material": grey,
        },
    })


def run_mitsuba(mi, scene, truth, mask, samples_per_pixel):
    """Seconds of a render after one that compiled its kernels."""
    integrator = mi.load_dict({"type": "ptracer", "max_depth": 3, "hide_emitters": True})
    most = 64
    total = np.zeros((EDGE, EDGE))
    seconds, done = 0.0, 0
    while done < samples_per_pixel:
        now = min(most, samples_per_pixel - done)
        np.array(mi.render(scene, integrator=integrator, spp=now, seed=0)) if done == 0 else None
        started = time.perf_counter()
        image = np.array(mi.render(scene, integrator=integrator, spp=now, seed=1 + done))
        seconds += time.perf_counter() - started
        total += now * math.pi * (image[..., 0] - image[..., 1])
        done += now
    image = total / done
    ratio = image[mask].mean() / truth[mask].mean()
    return samples_per_pixel * EDGE * EDGE, seconds, error(image, truth, mask), ratio


def plot(rows):
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "pinspot"
    from matplotlib import pyplot

    figure, (over_n, over_error) = pyplot.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained")
    for name, mark in (("flat", "s"), ("hierarchical", "o"), ("without occlusion", "D"), ("Mitsuba ptracer", "^")):
        of_name = sorted((row for row in rows if row["what"] == name), key=lambda row: row["n"])
        numbers, seconds, errors = ([row[key] for row in of_name] for key in ("n", "seconds", "error"))
        over_n.loglog(numbers, seconds, marker=mark, label=name)
        over_error.loglog(errors, seconds, marker=mark, label=name)
    over_n.set(xlabel="leaves (Mitsuba: light paths)", ylabel="seconds, one core")
    over_error.set(xlabel="relative error")
    ticks = (0.01, 0.02, 0.05, 0.1, 0.2)
    over_error.set_xticks(ticks, [str(tick) for tick in ticks])
    over_error.minorticks_off()
    over_n.legend(frameon=False)
    for axes in (over_n, over_error):
        axes.grid(which="major", alpha=0.3)
    figure.suptitle("Caustic of the ring under a tiny sun, 512²")
    figure.savefig(PLOT, metadata={"Date": None})


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="few and short runs: only to see whether it works")
    options.add_argument("--plot", action="store_true", help="only draw the results of the last run again")
    options = options.parse_args()
    if options.plot:
        kinds = {"what": str, "n": int, "seconds": float, "error": float}
        with open(WORK / "results.csv", newline="") as file:
            return plot([{key: kinds[key](value) for key, value in row.items()} for row in csv.DictReader(file)])
    quick = options.quick
    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    drjit.set_thread_count(1)
    WORK.mkdir(parents=True, exist_ok=True)
    precision = 0.05 if quick else 0.003
    centres, pixels = reference("1", "full", 1, precision), reference("2", "full", 2, precision)
    unoccluded = reference("none", "none", 1, precision)
    mask, unoccluded_mask = mask_of(centres), mask_of(unoccluded)
    rows = []

    def note(what, n, seconds, relative_error, more=""):
        rows.append({"what": what, "n": n, "seconds": round(seconds, 4), "error": round(relative_error, 5)})
        print(f"{what:18} {n:>12,} {seconds:9.3f} s  error {relative_error:.4f} {more}", flush=True)

    for samples in (250,) if quick else (250, 1000, 4000):
        note("flat", *run_pinspot(centres, mask, "flat", samples, 1))
    for samples, leaves in ((250, 4),) if quick else ((250, 4), (250, 16), (250, 64), (500, 64), (1000, 64), (1000, 256), (1000, 1024)):
        note("hierarchical", *run_pinspot(centres, mask, "hierarchical", samples, leaves))
        note("without occlusion", *run_pinspot(unoccluded, unoccluded_mask, "hierarchical", samples, leaves, "none"))
    scene = mitsuba_scene(mi)
    for spp in (16,) if quick else (16, 64, 256, 1024, 4096):
        *result, ratio = run_mitsuba(mi, scene, pixels, mask, spp)
        note("Mitsuba ptracer", *result, f"mean {ratio:.4f} of the reference's")
    if quick:
        return
    with open(WORK / "results.csv", "w", newline="") as file:
        table = csv.DictWriter(file, fieldnames=rows[0])
        table.writeheader()
        table.writerows(rows)
    plot(rows)


if __name__ == "__main__":
    main()
