"""A small renderer: shaded triangles and tubes into pixels, seen from far away."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.kernels import inner, kernel
from myomorph.lab.report.scene.image import Bytes

FAR = -1e30
EDGE = 0.62
"""Brightness of silhouettes."""


@read_only
class View:
    """An orthographic camera."""

    axes: Array  # (3, 3) rows: to the right of the picture, up in it, towards the viewer
    center: Array  # (3,) point in the middle of the picture [m]
    scale: float  # pixels per meter
    # width, height: of the picture [pixels]
    width: int
    height: int

    def project(self, points: Array) -> Array:
        """Project points to the picture.

        Parameters
        ----------
        points : (..., 3) in ground [m]

        Returns
        -------
        (..., 3) pixels to the right, pixels down and nearness in pixels
        """
        local = (np.asarray(points) - self.center) @ self.axes.T * self.scale
        local[..., 0] += self.width / 2
        local[..., 1] = self.height / 2 - local[..., 1]
        return local


class Canvas:
    """Color and nearness of every pixel, drawn into and then made a picture."""

    def __init__(self, view: View):
        self.view = view
        self.color = np.zeros((view.height, view.width, 3))
        self.near = np.full((view.height, view.width), FAR)

    def surface(self, vertices: Array, normals: Array, faces: np.ndarray, color: ArrayLike) -> None:
        """Draw triangles.

        Parameters
        ----------
        vertices : (n, 3) in ground [m]
        normals : (n, 3) that light the surface
        faces : (triangles, 3) indices of vertices
        color : (3,) red, green, blue from 0 to 1
        """
        points = np.ascontiguousarray(self.view.project(vertices))
        turned = np.ascontiguousarray(normals @ self.view.axes.T)
        fill_triangles(
            points,
            turned,
            np.ascontiguousarray(faces),
            np.array(color, dtype=np.float64),
            self.color,
            self.near,
        )

    def tubes(self, starts: Array, ends: Array, radii: Array, colors: Array) -> None:
        """Draw round tubes between points.

        Parameters
        ----------
        starts, ends : (n, 3) in ground [m]
        radii : (n, 2) at both ends [m]
        colors : (n, 3) red, green, blue from 0 to 1
        """
        if len(starts):
            fill_tubes(
                np.ascontiguousarray(self.view.project(starts)),
                np.ascontiguousarray(self.view.project(ends)),
                np.ascontiguousarray(radii * self.view.scale),
                np.ascontiguousarray(colors, dtype=np.float64),
                self.color,
                self.near,
            )

    def picture(self, shrink: int) -> Bytes:
        """Average pixels to the picture, with silhouettes drawn darker.

        Parameters
        ----------
        shrink : `shrink` x `shrink` pixels become one

        Returns
        -------
        (height, width, 4) red, green, blue, opacity
        """
        height = self.near.shape[0] // shrink
        width = self.near.shape[1] // shrink
        pixels = np.zeros((height, width, 4), dtype=np.uint8)
        # A silhouette is where what is behind lies so much farther away.
        shrink_pixels(self.color, self.near, shrink, 0.02 * self.view.height, pixels)
        return pixels


@inner
def lit(n0, n1, n2):
    """Compute the brightness of a surface with this normal.

    A soft light comes from the upper left, a little from the viewer.
    """
    if n2 < 0.0:
        n0 = -n0
        n1 = -n1
        n2 = -n2
    key = -0.35 * n0 + 0.55 * n1 + 0.76 * n2
    return 0.42 + 0.48 * max(key, 0.0) + 0.14 * n2


@kernel
def fill_triangles(  # page: numbers of one pixel, which stay in registers
    points, normals, faces, color, image, near
):
    """Draw triangles: `points` (n, 3) pixels and nearness, `normals` (n, 3) in the view's axes."""
    height, width = near.shape
    for f in range(faces.shape[0]):
        a = faces[f, 0]
        b = faces[f, 1]
        c = faces[f, 2]
        ax = points[a, 0]
        ay = points[a, 1]
        bx = points[b, 0]
        by = points[b, 1]
        cx = points[c, 0]
        cy = points[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        left = max(0, int(np.floor(min(ax, bx, cx))))
        right = min(width - 1, int(np.ceil(max(ax, bx, cx))))
        top = max(0, int(np.floor(min(ay, by, cy))))
        bottom = min(height - 1, int(np.ceil(max(ay, by, cy))))
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                px = x + 0.5
                py = y + 0.5
                u = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
                v = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                z = u * points[a, 2] + v * points[b, 2] + w * points[c, 2]
                if z <= near[y, x]:
                    continue
                near[y, x] = z
                n0 = u * normals[a, 0] + v * normals[b, 0] + w * normals[c, 0]
                n1 = u * normals[a, 1] + v * normals[b, 1] + w * normals[c, 1]
                n2 = u * normals[a, 2] + v * normals[b, 2] + w * normals[c, 2]
                size = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-30
                brightness = lit(n0 / size, n1 / size, n2 / size)
                for i in range(3):
                    image[y, x, i] = color[i] * brightness


@kernel
def fill_tubes(  # page: numbers of one pixel, which stay in registers
    starts, ends, radii, colors, image, near
):
    """Draw tubes with round ends between `starts` and `ends` (n, 3) pixels and nearness."""
    height, width = near.shape
    for s in range(starts.shape[0]):
        ax = starts[s, 0]
        ay = starts[s, 1]
        az = starts[s, 2]
        dx = ends[s, 0] - ax
        dy = ends[s, 1] - ay
        dz = ends[s, 2] - az
        if not np.isfinite(ax + ay + az + dx + dy + dz):
            continue
        most = max(radii[s, 0], radii[s, 1])
        left = max(0, int(np.floor(min(ax, ax + dx) - most)))
        right = min(width - 1, int(np.ceil(max(ax, ax + dx) + most)))
        top = max(0, int(np.floor(min(ay, ay + dy) - most)))
        bottom = min(height - 1, int(np.ceil(max(ay, ay + dy) + most)))
        long = dx * dx + dy * dy
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                px = x + 0.5 - ax
                py = y + 0.5 - ay
                t = 0.0 if long < 1e-12 else min(max((px * dx + py * dy) / long, 0.0), 1.0)
                r = radii[s, 0] + t * (radii[s, 1] - radii[s, 0])
                ox = px - t * dx
                oy = py - t * dy
                d = ox * ox + oy * oy
                if d >= r * r:
                    continue
                out = np.sqrt(r * r - d)
                z = az + t * dz + out
                if z <= near[y, x]:
                    continue
                near[y, x] = z
                brightness = lit(ox / r, -oy / r, out / r)
                for i in range(3):
                    image[y, x, i] = colors[s, i] * brightness


@inner
def stands_out(near, y, x, step):
    """Return whether a pixel is nearer than one of its four neighbours by a step."""
    here = near[y, x]
    height, width = near.shape
    return (
        (y > 0 and here - near[y - 1, x] > step)
        or (y < height - 1 and here - near[y + 1, x] > step)
        or (x > 0 and here - near[y, x - 1] > step)
        or (x < width - 1 and here - near[y, x + 1] > step)
    )


@kernel
def shrink_pixels(image, near, shrink, step, pixels):
    """Average `shrink` x `shrink` pixels of an image, its silhouettes darker, into `pixels`.

    `pixels` (height, width, 4) are red, green, blue and opacity, the share that is drawn.
    """
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            drawn = 0
            red = 0.0
            green = 0.0
            blue = 0.0
            for y in range(row * shrink, (row + 1) * shrink):
                for x in range(column * shrink, (column + 1) * shrink):
                    if near[y, x] <= FAR / 2:
                        continue
                    shade = EDGE if stands_out(near, y, x, step) else 1.0
                    drawn += 1
                    red += shade * image[y, x, 0]
                    green += shade * image[y, x, 1]
                    blue += shade * image[y, x, 2]
            if drawn == 0:
                continue
            pixels[row, column, 0] = int(255.0 * min(red / drawn, 1.0))
            pixels[row, column, 1] = int(255.0 * min(green / drawn, 1.0))
            pixels[row, column, 2] = int(255.0 * min(blue / drawn, 1.0))
            pixels[row, column, 3] = int(255.0 * drawn / (shrink * shrink))
