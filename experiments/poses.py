# SPDX-License-Identifier: BSD-3-Clause
"""Rotations and rigid motions in plain Python.

Matrices are sequences of rows. Quaternions are unit quaternions w, x, y, z.
"""


def quaternion_from_rotation(r):
    """The quaternion (w, x, y, z) of a 3 x 3 rotation matrix."""
    trace = r[0][0] + r[1][1] + r[2][2]
    k = max(range(3), key=lambda i: r[i][i])
    if trace > r[k][k]:
        s = 2.0 * (1.0 + trace) ** 0.5
        return (s / 4, (r[2][1] - r[1][2]) / s, (r[0][2] - r[2][0]) / s,
                (r[1][0] - r[0][1]) / s)
    i, j = (k + 1) % 3, (k + 2) % 3
    s = 2.0 * (1.0 + r[k][k] - r[i][i] - r[j][j]) ** 0.5
    q = [0.0] * 4
    q[0] = (r[j][i] - r[i][j]) / s
    q[1 + k], q[1 + i], q[1 + j] = (s / 4, (r[i][k] + r[k][i]) / s,
                                    (r[j][k] + r[k][j]) / s)
    return tuple(q)


def rotation_from_quaternion(w, x, y, z):
    """The 3 x 3 rotation matrix of a unit quaternion."""
    return ((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)))


def product(a, b):
    """The product of two 4 x 4 matrices."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)]
            for i in range(4)]


def inverse(pose):
    """(R^T, -R^T t): the 3 x 3 rotation and the translation of the inverse of a
    rigid 4 x 4 matrix."""
    r = [[pose[k][i] for k in range(3)] for i in range(3)]
    t = [-sum(r[i][k] * pose[k][3] for k in range(3)) for i in range(3)]
    return r, t


def camera_center(quaternion, translation):
    """-R^T t: the center, in world units, of a camera with cam_from_world."""
    rows = rotation_from_quaternion(*quaternion)
    a, b, c = translation
    return tuple(-(rows[0][i] * a + rows[1][i] * b + rows[2][i] * c)
                 for i in range(3))
