"""Time and error of Pinspot and of Mitsuba 3's particle tracer on the same work, one core each.

The work is the caustic of the built-in scene `ring-above`: one bounce of light by a ring onto a table, with occlusion; under the
scene's tiny sun at 512², and under the built-in map `forest` at 511². Errors are relative, over the pixels that count (not within
15 mm of the ring's wall, nor where it is dark), against `pinspot reference`. Under the sun that is at pixel centres for Pinspot, and
over pixels for Mitsuba, whose film knows no centres. In forest light, of which the ground truth takes longer, every seventh pixel of
every seventh row is compared, at its centre: caustics of natural light hardly change within a pixel. Mitsuba cannot leave occlusion
out; Pinspot can, and is also held against the ground truth without it.

Mitsuba renders the scene with its integrators as they are. Mirrors are red and all else is grey, the light, too, so that red minus
green is what the mirror brought; of Pinspot's pictures it is held against the green. Its environment is a map that is not rotated (with
a rotation `ptracer` of 3.9 is too bright), and its camera is far away: seen in perspective, a plane stays a plane.
"""

import argparse
import collections.abc
import csv
import dataclasses
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
# The scene's numbers: src/scene/builtin/ring-above.toml.
TO_SUN = np.array([0.6123724, 0.7071068, -0.3535534])
SIGMA = 0.011284
RADIANCE = 1250.0
TABLE = 3.0


@dataclasses.dataclass(frozen=True)
class Light:
    """What the scene is seen in, and at which size."""

    name: str
    title: str
    # Of Pinspot's command line.
    options: tuple[str, ...]
    # Makes Mitsuba's map of it.
    radiance_map: collections.abc.Callable[[], np.ndarray]
    edge: int
    # Every so many pixels are compared.
    stride: int
    # Of Mitsuba's renderings; seconds grow with them.
    samples_per_pixel: tuple[int, ...]
    # Relative standard error of the ground truth.
    precision: float

    @property
    def results(self):
        return WORK / f"results-{self.name}.csv"


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


def reference(light, name, visibility, pixel_samples, relative_error):
    """The ground truth: at pixel centres, or over pixels if there are several samples of each."""
    path = WORK / f"reference-{light.name}-{name}.exr"
    edge = light.edge // light.stride
    command = [PINSPOT, "reference", SCENE, *light.options, "--visibility", visibility, "--size", f"{edge}x{edge}", "--quiet"]
    command += ["--pixel-samples", str(pixel_samples), "--rel-error", str(relative_error), "--output", str(path)]
    subprocess.run(command, check=True)
    return read(path)[..., 1]


def mask_of(truth):
    """Where errors count."""
    edge = truth.shape[0]
    at = (np.arange(edge) + 0.5) / edge * TABLE - 0.5 * TABLE
    radius = np.hypot(*np.meshgrid(at, at))
    return (truth > 0.02 * np.quantile(truth, 0.999)) & (np.abs(radius - 1.0) > 0.015)


def compared(light, image):
    """The pixels of an image that the ground truth has."""
    return image[light.stride // 2 :: light.stride, light.stride // 2 :: light.stride]


def error(light, image, truth, mask):
    image = compared(light, image)
    return math.sqrt(((image - truth)[mask] ** 2).sum() / (truth[mask] ** 2).sum())


def run_pinspot(light, truth, mask, evaluation, samples, leaves, visibility="full", tolerance=0.1):
    """Seconds for all that follows a moving mirror: samples, cells, what they see, the gather. Best of three."""
    path = WORK / "pinspot.exr"
    command = ["render", SCENE, *light.options, "--size", f"{light.edge}x{light.edge}", "--aov", "caustic", "--backend", "cpu"]
    command += ["--visibility", visibility, "--samples", str(samples), "--evaluation", evaluation, "--leaves", str(leaves)]
    command += ["--output", str(path)]
    if evaluation == "hierarchical":
        command += ["--tolerance", str(tolerance)]
    best = math.inf
    for _ in range(3 if evaluation == "hierarchical" else 1):
        report = pinspot(*command)
        best = min(best, sum(report["seconds"].get(stage, 0.0) for stage in STAGES_AFTER_A_MOVE))
    return report["samples"] * leaves, best, error(light, read(path)[..., 1], truth, mask)


def polar_angles(height):
    """Of the rows of Mitsuba's maps: the first and the last lie on the poles."""
    return np.pi * np.arange(height) / (height - 1)


def sun_map(width=4096):
    height = width // 2
    u = 2.0 * np.pi * (np.arange(width) + 0.5) / width
    v = polar_angles(height)
    directions = np.stack(
        [np.sin(v)[:, None] * np.sin(u), np.broadcast_to(np.cos(v)[:, None], (height, width)), -np.sin(v)[:, None] * np.cos(u)],
        axis=-1,
    )
    to_sun = TO_SUN / np.linalg.norm(TO_SUN)
    angle = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(directions - to_sun, axis=-1), 1.0))
    radiance = RADIANCE * np.exp(-0.5 * (angle / SIGMA) ** 2)
    return np.repeat(radiance[..., None], 3, axis=-1).astype(np.float32)


def forest_map():
    """The built-in map's green as grey. The middles of its rows lie half a row from the poles."""
    image = np.repeat(read(ROOT / "envmaps" / "forest.exr")[..., 1:2], 3, axis=-1)
    height = len(image)
    row = np.clip(polar_angles(4 * height) / np.pi * height - 0.5, 0.0, height - 1.0)
    upper = np.minimum(row.astype(int), height - 2)
    part = (row - upper)[:, None, None]
    return ((1.0 - part) * image[upper] + part * image[upper + 1]).astype(np.float32)


LIGHTS = (
    Light("sun", "tiny sun", (), sun_map, 512, 1, (16, 64, 256, 1024, 4096), 0.003),
    Light("forest", "forest light", ("--env", "forest"), forest_map, 511, 7, (16, 64, 256, 1024), 0.005),
)


def mitsuba_scene(mi, light):
    distance = 400.0
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    rotate = mi.ScalarTransform4f().rotate
    return mi.load_dict({
        "type": "scene",
        "environment": {"type": "envmap", "bitmap": mi.Bitmap(light.radiance_map())},
        "camera": {
            "type": "perspective",
            "fov": math.degrees(2.0 * math.atan(0.5 * TABLE / distance)),
            "near_clip": 1.0,
            "far_clip": 2.0 * distance,
            "to_world": mi.ScalarTransform4f().look_at(origin=[0, distance, 0], target=[0, 0, 0], up=[0, 0, -1]),
            "film": {
                "type": "hdrfilm",
                "width": light.edge,
                "height": light.edge,
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


def run_mitsuba(mi, scene, light, truth, mask, samples_per_pixel):
    """Seconds of a render after one that compiled its kernels."""
    integrator = mi.load_dict({"type": "ptracer", "max_depth": 3, "hide_emitters": True})
    most = 64
    total = np.zeros((light.edge, light.edge))
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
    ratio = compared(light, image)[mask].mean() / truth[mask].mean()
    return samples_per_pixel * light.edge**2, seconds, error(light, image, truth, mask), ratio


def plot():
    """The results of the last runs."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "pinspot"
    from matplotlib import pyplot

    lights = [light for light in LIGHTS if light.results.exists()]
    if not lights:
        raise SystemExit(f"{WORK} holds no results: run benches/peers/run first")
    figure, panels = pyplot.subplots(1, 1 + len(lights), figsize=(4.2 * (1 + len(lights)), 3.6), layout="constrained")
    for light, panel in zip(lights, panels[1:]):
        with open(light.results, newline="") as file:
            rows = sorted(csv.DictReader(file), key=lambda row: int(row["n"]))
        for name, mark in (("flat", "s"), ("hierarchical", "o"), ("without occlusion", "D"), ("Mitsuba ptracer", "^")):
            of_name = [row for row in rows if row["what"] == name]
            numbers, seconds, errors = ([float(row[key]) for row in of_name] for key in ("n", "seconds", "error"))
            panel.loglog(errors, seconds, marker=mark, label=name)
            if light is lights[0]:
                panels[0].loglog(numbers, seconds, marker=mark, label=name)
        panel.set(title=light.title, xlabel="relative error")
        ticks = (0.01, 0.02, 0.05, 0.1, 0.2)
        panel.set_xticks(ticks, [str(tick) for tick in ticks])
        panel.minorticks_off()
    panels[0].set(title=lights[0].title, xlabel="leaves (Mitsuba: light paths)", ylabel="seconds, one core")
    panels[0].legend(frameon=False)
    for panel in panels:
        panel.grid(which="major", alpha=0.3)
    figure.suptitle("Caustic of the ring")
    figure.savefig(PLOT, metadata={"Date": None})


def compare(mi, light, quick):
    """Times and errors in one light, printed and written to its file of results."""
    precision = 0.05 if quick else light.precision
    centres, unoccluded = reference(light, "1", "full", 1, precision), reference(light, "none", "none", 1, precision)
    pixels = reference(light, "2", "full", 2, precision) if light.stride == 1 else centres
    mask, unoccluded_mask = mask_of(centres), mask_of(unoccluded)
    rows = []

    def note(what, n, seconds, relative_error, more=""):
        rows.append({"what": what, "n": n, "seconds": round(seconds, 4), "error": round(relative_error, 5)})
        print(f"{light.name:8} {what:18} {n:>12,} {seconds:9.3f} s  error {relative_error:.4f} {more}", flush=True)

    for samples in (250,) if quick else (250, 1000, 4000):
        note("flat", *run_pinspot(light, centres, mask, "flat", samples, 1))
    for samples, leaves in ((250, 4),) if quick else ((250, 4), (250, 16), (250, 64), (500, 64), (1000, 64), (1000, 256), (1000, 1024)):
        note("hierarchical", *run_pinspot(light, centres, mask, "hierarchical", samples, leaves))
        note("without occlusion", *run_pinspot(light, unoccluded, unoccluded_mask, "hierarchical", samples, leaves, "none"))
    scene = mitsuba_scene(mi, light)
    for spp in (16,) if quick else light.samples_per_pixel:
        *result, ratio = run_mitsuba(mi, scene, light, pixels, mask, spp)
        note("Mitsuba ptracer", *result, f"mean {ratio:.4f} of the reference's")
    if quick:
        return
    with open(light.results, "w", newline="") as file:
        table = csv.DictWriter(file, fieldnames=rows[0])
        table.writeheader()
        table.writerows(rows)


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="few and short runs: only to see whether it works")
    options.add_argument("--light", choices=[light.name for light in LIGHTS], help="only in this light")
    options.add_argument("--plot", action="store_true", help="only draw the results of the last runs again")
    options = options.parse_args()
    if options.plot:
        return plot()
    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    drjit.set_thread_count(1)
    WORK.mkdir(parents=True, exist_ok=True)
    for light in LIGHTS:
        if options.light in (None, light.name):
            compare(mi, light, options.quick)
    if not options.quick:
        plot()


if __name__ == "__main__":
    main()
