"""Pinspot's pictures beside those of a path tracer that shares no code with it: Mitsuba 3 traces the rays and places the shapes.

The path tracer follows what Pinspot's pictures show: the camera's rays through any number of mirrors to a diffuse surface, from there
to the environment, straight or by one mirror. Both pictures are linear, exposed and tone-mapped alike (Khronos PBR Neutral), and
compared by FLIP at 67 pixels per degree. The scenes are the built-in ones without what is not physical (gain of the caustic, exposure of
the background); where the camera sees the environment itself, Pinspot smooths the texels of maps that are coarser than the picture, hence
errors of objects alone. `columns` has a mirror whose reflectance does not depend on the angle.
"""

import argparse
import math
import pathlib
import re
import subprocess
import tomllib

import drjit as dr
import flip_evaluator
import mitsuba as mi
import numpy as np
import OpenEXR

mi.set_variant("llvm_ad_rgb")

ROOT = pathlib.Path(__file__).resolve().parents[2]
WORK = ROOT / "target" / "peers"
PINSPOT = ROOT / "target" / "release" / "pinspot"
# Scenes, and the environments that they are seen in: without a small sun, which no such path tracer finds by chance.
SCENES = (("ring-natural", "forest"), ("columns", "forest"), ("mirror-sphere", "studio"))
NOT_PHYSICAL = re.compile(r"^(caustic_gain|background_exposure_ev) = .*\n", re.MULTILINE)
MAX_MIRRORS = 12
# Directions from which light comes to a surface, for each ray of the camera.
INCIDENT = 16
# Of the backs of mirrors, which are no receivers.
PLAIN_ALBEDO = 0.2
# 1 over the plastic number and over its square, as parts of 2³².
PLASTIC = (3242174889, 2447445414)
# Beyond the surface that a ray leaves, metres.
STEP = 1e-4


def scene_text(name):
    """The built-in scene, as both render it."""
    text = (ROOT / "src" / "scene" / "builtin" / f"{name}.toml").read_text()
    return NOT_PHYSICAL.sub("", text).replace('metal = "brass"', "reflectance = [0.9, 0.78, 0.45]")


def read(path):
    """R, G, B of an OpenEXR image."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return np.stack([channels[c].pixels for c in "RGB"], axis=-1).astype(np.float32)


def run_pinspot(name, environment, edge):
    """The linear beauty picture at default settings."""
    scene, picture = WORK / f"{name}.toml", WORK / f"{name}-pinspot.exr"
    scene.write_text(scene_text(name))
    command = [PINSPOT, "render", scene, "--env", environment, "--size", f"{edge}x{edge}", "--backend", "cpu"]
    subprocess.run([*command, "--quiet", "-o", picture], check=True)
    return read(picture)


def solid_ring(radius, height, thickness):
    """A closed ring with a rectangular profile around y: vertices and triangles. Pinspot's have slightly rounded edges."""
    segments = 512
    inner, outer = radius - 0.5 * thickness, radius + 0.5 * thickness
    profile = [(inner, 0.0), (outer, 0.0), (outer, height), (inner, height)]
    angles = 2.0 * np.pi * np.arange(segments) / segments
    vertices = np.concatenate([np.stack([r * np.cos(angles), np.full(segments, y), r * np.sin(angles)], -1) for r, y in profile])
    faces = []
    for side in range(4):
        a, b = side * segments, (side + 1) % 4 * segments
        i, j = np.arange(segments), np.roll(np.arange(segments), -1)
        faces += [np.stack([a + i, b + i, a + j], -1), np.stack([b + i, b + j, a + j], -1)]
    return vertices, np.concatenate(faces)


def mesh(vertices, faces):
    shape = mi.Mesh("ring", len(vertices), len(faces))
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return shape


def shape_of(description):
    """A Mitsuba shape for an object of a scene file."""
    (kind, numbers), = description["shape"].items()
    offset = np.array(description.get("translate", [0.0, 0.0, 0.0]), dtype=float)
    if kind == "ring":
        up = np.array([0.0, numbers["height"], 0.0])
        return mi.load_dict({"type": "cylinder", "p0": list(offset), "p1": list(offset + up), "radius": numbers["radius"], "flip_normals": True})
    if kind == "sphere":
        return mi.load_dict({"type": "sphere", "center": list(offset), "radius": numbers["radius"]})
    if kind == "solid-ring":
        vertices, faces = solid_ring(**numbers)
        return mesh(vertices + offset, faces)
    assert kind == "plane" and "rotate_deg" not in description, kind
    half = 0.5 * np.array(numbers["size"])
    corners = np.array([[-half[0], 0, -half[1]], [-half[0], 0, half[1]], [half[0], 0, half[1]], [half[0], 0, -half[1]]])
    return mesh(corners + offset, np.array([[0, 1, 2], [0, 2, 3]]))


class Points:
    """Points of Kronecker sequences in the plane, shifted at random in every pixel."""

    def __init__(self, edge, samples, first):
        index = dr.arange(mi.UInt32, edge * edge * samples)
        self.pixel, self.number = index // samples, index % samples + first

    def pair(self, which, k=0):
        """A point in the unit square from one of three sequences: on the pixel, or for the k-th ray of light of either kind."""
        number = self.number * (INCIDENT if which else 1) + k
        shifts = mi.sample_tea_32(self.pixel, mi.UInt32(which))
        return mi.Point2f(*[mi.Float((shift + number * mi.UInt32(step)) >> 8) * 2.0**-24 for shift, step in zip(shifts, PLASTIC)])


class PathTracer:
    """The scene in Mitsuba's shapes, and what its objects reflect."""

    def __init__(self, name, environment):
        document = tomllib.loads(scene_text(name))
        shapes = [shape_of(o) for o in document["object"]]
        self.scene = mi.load_dict({"type": "scene", **{f"shape{k}": shape for k, shape in enumerate(shapes)}})
        self.objects = list(zip([mi.ShapePtr(shape) for shape in shapes], document["object"]))
        self.camera = document["camera"]
        self.rotation = math.radians(document["environment"].get("rotation_deg", 0.0))
        image = read(ROOT / "envmaps" / f"{environment}.exr")
        self.environment = mi.Texture2f(mi.TensorXf(image), wrap_mode=dr.WrapMode.Repeat)
        rows = np.sin(np.pi * (np.arange(image.shape[0]) + 0.5) / image.shape[0])
        self.brightness = mi.MarginalContinuous2D0((image.sum(axis=-1) * rows[:, None] + 1e-4 * image.mean()).astype(np.float32))

    def towards_map(self, d):
        """A direction in the map's own frame, and where on the image it is: +Z at the centre, +X to the left of it."""
        cos, sin = math.cos(self.rotation), math.sin(self.rotation)
        x, z = cos * d.x - sin * d.z, sin * d.x + cos * d.z
        u = dr.atan2(x, -z) / (2.0 * dr.pi)
        return mi.Point2f(u - dr.floor(u), dr.acos(dr.clip(d.y, -1.0, 1.0)) / dr.pi)

    def from_map(self, place):
        """The direction of a place on the image."""
        cos, sin = math.cos(self.rotation), math.sin(self.rotation)
        angle, polar = 2.0 * dr.pi * place.x, dr.pi * place.y
        x, z = dr.sin(polar) * dr.sin(angle), -dr.sin(polar) * dr.cos(angle)
        return mi.Vector3f(cos * x + sin * z, dr.cos(polar), cos * z - sin * x)

    def light(self, d, active):
        """Radiance from a direction."""
        return mi.Color3f(self.environment.eval(self.towards_map(d), active))

    def surface(self, si, hit):
        """Reflectance of mirrors' front sides; albedo of other surfaces; and whether they receive caustics, as the backs of mirrors do not."""
        mirrored, albedo, receives = mi.Color3f(0.0), mi.Color3f(0.0), mi.Bool(True)
        for pointer, description in self.objects:
            here = hit & (si.shape == pointer)
            if "reflector" in description:
                front = dr.dot(si.n, si.to_world(si.wi)) > 0.0
                mirrored = dr.select(here & front, mi.Color3f(description["reflector"]["reflectance"]), mirrored)
                albedo = dr.select(here & ~front, mi.Color3f(PLAIN_ALBEDO), albedo)
                receives &= ~here
            else:
                albedo = dr.select(here, mi.Color3f(description["receiver"]["albedo"]), albedo)
        return mirrored, albedo, receives

    def intersect(self, origin, direction, active):
        ray = mi.Ray3f(origin, direction)
        return self.scene.ray_intersect(ray, mi.RayFlags.All, False, active)

    def camera_rays(self, edge, points):
        position, target = (np.array(self.camera[key]) for key in ("position", "target"))
        forward = (target - position) / np.linalg.norm(target - position)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        half = math.tan(0.5 * math.radians(self.camera["perspective"]["fov_y_deg"]))
        right, up, forward = (mi.Vector3f(*map(float, v)) for v in (half * right, half * up, forward))
        within = points.pair(0)
        x = (mi.Float(points.pixel % edge) + within.x) / edge
        y = (mi.Float(points.pixel // edge) + within.y) / edge
        return mi.Point3f(*map(float, position)), dr.normalize(forward + (2.0 * x - 1.0) * right + (1.0 - 2.0 * y) * up)

    def radiance(self, edge, samples, first):
        """The mean over pixels, from so many points of each beginning with the given one."""
        points = Points(edge, samples, first)
        origin, direction = self.camera_rays(edge, points)
        radiance, throughput = mi.Color3f(0.0), mi.Color3f(1.0)
        end = {"place": mi.Point3f(0.0), "normal": mi.Vector3f(0.0, 1.0, 0.0), "receives": mi.Bool(False), "albedo": mi.Color3f(0.0)}
        active = mi.Bool(True)
        for _ in range(MAX_MIRRORS):
            si = self.intersect(origin, direction, active)
            hit = active & si.is_valid()
            radiance += dr.select(active & ~hit, throughput * self.light(direction, active), 0.0)
            mirrored, albedo, receives = self.surface(si, hit)
            active = hit & (dr.max(mirrored) > 0.0)
            ends = hit & ~active
            towards = dr.select(dr.dot(si.n, direction) < 0.0, si.n, -si.n)
            here = {"place": si.p, "normal": towards, "receives": receives, "albedo": throughput * albedo}
            end = {key: dr.select(ends, here[key], value) for key, value in end.items()}
            throughput = dr.select(active, throughput * mirrored, throughput)
            direction = dr.select(active, direction - 2.0 * dr.dot(direction, si.n) * si.n, direction)
            origin = dr.select(active, si.p + STEP * direction, origin)
            dr.eval(radiance, throughput, end, active, direction, origin)
            if dr.none(active):
                break
        incident = mi.Color3f(0.0)
        for k in range(INCIDENT):
            incident += self.incident(end, points, k)
            dr.eval(incident)
        radiance += end["albedo"] * incident / INCIDENT
        film = dr.zeros(mi.Float, 3 * edge * edge)
        for channel in range(3):
            dr.scatter_reduce(dr.ReduceOp.Add, film, radiance[channel], 3 * points.pixel + channel)
        return np.array(film).reshape(edge, edge, 3) / samples

    def incident(self, end, points, k):
        """Irradiance over π from the environment: straight, from a place chosen by its brightness, and by one mirror."""
        active = dr.max(end["albedo"]) > 0.0
        origin = end["place"] + STEP * end["normal"]
        place, density = self.brightness.sample(points.pair(1, k))
        direction = self.from_map(place)
        cosine = dr.dot(direction, end["normal"])
        lit = active & (cosine > 0.0) & ~self.scene.ray_test(mi.Ray3f(origin, direction), active)
        solid_angle = 2.0 * dr.square(dr.pi) * dr.sin(dr.pi * place.y) / dr.maximum(density, 1e-20)
        light = dr.select(lit, self.light(direction, lit) * cosine * solid_angle / dr.pi, 0.0)

        active &= end["receives"]
        direction = mi.Frame3f(end["normal"]).to_world(mi.warp.square_to_cosine_hemisphere(points.pair(2, k)))
        si = self.intersect(origin, direction, active)
        mirrored, _, _ = self.surface(si, active & si.is_valid())
        active &= dr.max(mirrored) > 0.0
        direction = direction - 2.0 * dr.dot(direction, si.n) * si.n
        escapes = active & ~self.scene.ray_test(mi.Ray3f(si.p + STEP * direction, direction), active)
        return light + dr.select(escapes, mirrored * self.light(direction, escapes), 0.0)

    def sees_objects(self, edge):
        """Whether the ray through a pixel's first point meets anything."""
        rays = mi.Ray3f(*self.camera_rays(edge, Points(edge, 1, 0)))
        return np.array(self.scene.ray_test(rays)).reshape(edge, edge)


def flip(reference, image):
    """FLIP's error in each pixel, from 0 to 1."""
    return flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False)[0].squeeze()


def metered(image):
    """The factor that makes the median a middle grey, unless the brightest parts would wash out."""
    luminance = image @ np.array([0.2126, 0.7152, 0.0722])
    lit = luminance[luminance > 0.0]
    return min(0.22 / np.quantile(lit, 0.5), 2.5 / np.quantile(lit, 0.98))


def shown(image, exposure):
    """Exposed and tone-mapped: Khronos PBR Neutral, display-linear, then sRGB."""
    colour = np.maximum(image.astype(np.float64) * exposure, 0.0)
    least = colour.min(axis=-1, keepdims=True)
    colour = colour - np.where(least < 0.08, least - 6.25 * least * least, 0.04)
    peak = colour.max(axis=-1, keepdims=True)
    start, desaturation = 0.8 - 0.04, 0.15
    room = 1.0 - start
    compressed = 1.0 - room * room / np.maximum(peak + room - start, 1e-9)
    grey = 1.0 - 1.0 / (desaturation * (peak - compressed) + 1.0)
    bright = colour * compressed / np.maximum(peak, 1e-9) * (1.0 - grey) + compressed * grey
    colour = np.where(peak < start, colour, bright)
    return np.where(colour <= 0.0031308, 12.92 * colour, 1.055 * np.maximum(colour, 1e-9) ** (1.0 / 2.4) - 0.055).astype(np.float32)


def write_png(path, image):
    pixels = np.clip(np.round(image * 255.0), 0, 255).astype(np.uint8)
    mi.Bitmap(pixels).write(str(path))


def compare(name, environment, edge, samples):
    tracer = PathTracer(name, environment)
    pinspot = run_pinspot(name, environment, edge)
    # Whole passes that memory holds, an even number of them.
    once = min(4_194_304 // (edge * edge), samples // 2)
    passes = [tracer.radiance(edge, once, first) for first in range(0, samples // (2 * once) * 2 * once, once)]
    half = len(passes) // 2
    halves = [np.mean(passes[:half], axis=0), np.mean(passes[half:], axis=0)]
    traced = np.mean(halves, axis=0)
    exposure = metered(traced)
    pictures = [shown(image, exposure) for image in (pinspot, traced, *halves)]
    errors, noise = flip(pictures[1], pictures[0]), flip(pictures[2], pictures[3])
    for what, picture in (("pinspot", pictures[0]), ("traced", pictures[1]), ("flip", errors[..., None].repeat(3, axis=-1))):
        write_png(WORK / f"beauty-{name}-{what}.png", picture)
    objects = tracer.sees_objects(edge)
    print(
        f"{name:14} under {environment:7} FLIP {errors.mean():.4f}, of objects {errors[objects].mean():.4f}; "
        f"between halves of the path tracer's samples {noise.mean():.4f}, {noise[objects].mean():.4f}",
        flush=True,
    )


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--edge", type=int, default=256, choices=range(16, 1025), metavar="PIXELS")
    options.add_argument(
        "--samples", type=int, default=256, choices=range(8, 65537), metavar="N",
        help=f"rays of the camera for each pixel; each is followed by {INCIDENT} rays of either kind",
    )
    options.add_argument("--scenes", default=",".join(name for name, _ in SCENES))
    options = options.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    for name, environment in SCENES:
        if name in options.scenes.split(","):
            compare(name, environment, options.edge, options.samples)


if __name__ == "__main__":
    main()
