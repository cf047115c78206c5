# SPDX-License-Identifier: BSD-3-Clause
"""Fits COLMAP's OPENCV_FISHEYE to the unified omnidirectional camera model.

Model: C. Mei and P. Rives, "Single view point omnidirectional camera
calibration from planar grids", ICRA 2007.
"""
import math
import re

import numpy as np

from experiments.text_files import names_its_file

NAMES = ("xi", "k1", "k2", "p1", "p2", "gamma1", "gamma2", "u0", "v0")


@names_its_file
def read_mei(path):
    """{name: number} of a calibration file in OpenCV's YAML."""
    numbers = {}
    for line in path.read_text().splitlines():
        found = re.match(r"\s*(\w+)\s*:\s*([-+.\deE]+)\s*$", line)
        if found:
            numbers[found[1]] = float(found[2])
    for name in ("gamma1", "gamma2"):
        if not 0.0 < numbers[name] < math.inf:
            raise ValueError(f"{name} is {numbers[name]}, not a focal length")
    if not 0.0 <= numbers["xi"] < math.inf:
        raise ValueError(f"xi is {numbers['xi']}, not a distance of centers")
    return {name: numbers[name] for name in NAMES}


def project_mei(mei, rays):
    """n x 2 pixels of n x 3 unit rays, with the parameters of read_mei()."""
    z = rays[:, 2] + mei["xi"]
    x, y = rays[:, 0] / z, rays[:, 1] / z
    r2 = x * x + y * y
    radial = 1.0 + mei["k1"] * r2 + mei["k2"] * r2 * r2
    p1, p2 = mei["p1"], mei["p2"]
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([mei["gamma1"] * u + mei["u0"],
                     mei["gamma2"] * v + mei["v0"]], axis=1)


def project_fisheye(p, rays):
    """n x 2 pixels of n x 3 rays; p: fx, fy, cx, cy, k1, k2, k3, k4."""
    across = np.hypot(rays[:, 0], rays[:, 1])
    theta = np.arctan2(across, rays[:, 2])
    t2 = theta * theta
    distorted = theta * (
        1 + t2 * (p[4] + t2 * (p[5] + t2 * (p[6] + t2 * p[7]))))
    factor = distorted / np.maximum(across, 1e-12)
    return np.stack([p[0] * factor * rays[:, 0] + p[2],
                     p[1] * factor * rays[:, 1] + p[3]], axis=1)


def rays_up_to(max_angle_deg):
    """n x 3 unit rays, up to an angle from the optical axis."""
    theta, phi = np.meshgrid(np.radians(np.linspace(0.5, max_angle_deg, 120)),
                             np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False))
    theta, phi = theta.ravel(), phi.ravel()
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi),
                     np.cos(theta)], axis=1)


def fit_fisheye(mei, max_angle_deg=95.0):
    """Least squares over rays up to an angle from the axis, by Gauss-Newton.

    Returns the 8 parameters of OPENCV_FISHEYE, and the root mean square and the
    largest difference in pixels.
    """
    rays = rays_up_to(max_angle_deg)
    pixels = project_mei(mei, rays)
    scale = 1.0 / (1.0 + mei["xi"])
    p = np.array([mei["gamma1"] * scale, mei["gamma2"] * scale, mei["u0"],
                  mei["v0"], 0.0, 0.0, 0.0, 0.0])
    for _ in range(20):
        residual = (project_fisheye(p, rays) - pixels).ravel()
        jacobian = np.empty((residual.size, p.size))
        for i in range(p.size):
            step = np.zeros(p.size)
            step[i] = 1e-6 * max(1.0, abs(p[i]))
            jacobian[:, i] = (project_fisheye(p + step, rays)
                              - project_fisheye(p - step, rays)).ravel()
            jacobian[:, i] /= 2.0 * step[i]
        p = p - np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    errors = np.linalg.norm(project_fisheye(p, rays) - pixels, axis=1)
    return p, float(np.sqrt((errors ** 2).mean())), float(errors.max())
