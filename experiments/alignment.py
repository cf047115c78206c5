# SPDX-License-Identifier: BSD-3-Clause
"""Alignment of a model with the ground truth by a similarity, in plain Python.

A pose is (quaternion of cam_from_world, camera center).
"""
import dataclasses
import math

from experiments import poses

NUM_ITERATIONS = 10  # of each reweighted fit
NOISE_M = 0.05  # residuals below have equal weights
MAX_RESIDUAL_M = 5.0  # poses beyond do not influence the fit
# A rotation counts like a point at this distance, where 0.6 degrees, a typical
# error, displace by NOISE_M: it determines the turn of a short straight path.
LEVER_M = 5.0


@dataclasses.dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation * x + translation."""

    scale: float
    rotation: tuple  # rows
    translation: tuple

    def apply(self, point):
        """The image of a point."""
        return tuple(self.scale * dot(row, point) + t
                     for row, t in zip(self.rotation, self.translation))


def dot(a, b):
    """The dot product of two vectors."""
    return sum(x * y for x, y in zip(a, b))


def pose_of(quaternion, translation):
    """The pose of an image of colmap_model.read_poses()."""
    return quaternion, poses.camera_center(quaternion, translation)


def align(model, truth):
    """The Similarity from the model to the truth: two lists of poses in order.

    Minimizes distances up to MAX_RESIDUAL_M, and the difference of rotations,
    by iteratively reweighted least squares. It starts from all poses, and from
    halves and quarters of them, so that a smaller part that is misplaced has no
    influence. The fit of least distances is returned.
    """
    count = len(model)
    starts = [(0, count)] + [
        (begin, begin + size) for size in (count // 2, count // 4)
        for begin in range(0, count - size + 1, max(1, size // 2)) if size > 3]
    fits = [fit_from(model, truth, begin, end) for begin, end in starts]
    return min(fits, key=lambda fit: cost_of(fit, model, truth))


def cost_of(fit, model, truth):
    """The sum of distances up to MAX_RESIDUAL_M."""
    return sum(min(MAX_RESIDUAL_M, math.dist(fit.apply(p), t))
               for (_, p), (_, t) in zip(model, truth))


def fit_from(model, truth, begin, end):
    """A local minimum: first of the poses in a range, then of all."""
    turns = [multiply(conjugate(q_truth), q_model)
             for (q_model, _), (q_truth, _) in zip(model, truth)]
    points = [center for _, center in model]
    targets = [center for _, center in truth]
    weights = [float(begin <= i < end) for i in range(len(points))]
    fit = weighted_fit(points, targets, weights, mean_turn(turns, weights))
    for _ in range(NUM_ITERATIONS):
        distances = [math.dist(fit.apply(p), t)
                     for p, t in zip(points, targets)]
        weights = [1.0 / max(NOISE_M, d) if d < MAX_RESIDUAL_M else 1e-9
                   for d in distances]
        fit = weighted_fit(points, targets, weights, mean_turn(turns, weights))
    return fit


def mean_turn(turns, weights):
    """The weighted mean of quaternions."""
    total = [0.0] * 4
    for turn, weight in zip(turns, weights):
        if dot(turn, total) < 0.0:
            weight = -weight
        total = [t + weight * x for t, x in zip(total, turn)]
    return normalized(total)


def weighted_fit(points, targets, weights, turn):
    """The best similarity by Horn's quaternion method.

    `turn`, the mean turn of the poses, counts like points at LEVER_M, and at
    least like a thousandth of the extent of the points.
    """
    total = sum(weights)
    center1 = weighted_mean(points, weights, total)
    center2 = weighted_mean(targets, weights, total)
    moved1 = [[x - c for x, c in zip(p, center1)] for p in points]
    moved2 = [[x - c for x, c in zip(t, center2)] for t in targets]
    products = [[sum(w * a[i] * b[j]
                     for w, a, b in zip(weights, moved1, moved2))
                 for j in range(3)] for i in range(3)]
    spread1 = sum(w * dot(a, a) for w, a in zip(weights, moved1))
    spread2 = sum(w * dot(b, b) for w, b in zip(weights, moved2))
    matrix = horn_matrix(products)
    scale = math.sqrt(spread2 / spread1) if spread1 > 1e-12 else 1.0
    prior = (1e-3 * math.sqrt(spread1 * spread2)
             + 2.0 * total * LEVER_M**2 / max(scale, 1e-12))
    for i in range(4):
        for j in range(4):
            matrix[i][j] += prior * turn[i] * turn[j]
    rotation = poses.rotation_from_quaternion(*largest_eigenvector(matrix))
    translation = tuple(c - scale * dot(row, center1)
                        for c, row in zip(center2, rotation))
    return Similarity(scale, rotation, translation)


def weighted_mean(points, weights, total):
    """The weighted mean of 3D points."""
    return [sum(w * p[i] for w, p in zip(weights, points)) / total
            for i in range(3)]


def horn_matrix(s):
    """The 4 x 4 matrix whose largest eigenvector is the rotation; s[i][j] sums
    products of coordinate i before and j after the rotation."""
    return [
        [s[0][0] + s[1][1] + s[2][2], s[1][2] - s[2][1], s[2][0] - s[0][2],
         s[0][1] - s[1][0]],
        [s[1][2] - s[2][1], s[0][0] - s[1][1] - s[2][2], s[0][1] + s[1][0],
         s[2][0] + s[0][2]],
        [s[2][0] - s[0][2], s[0][1] + s[1][0], s[1][1] - s[0][0] - s[2][2],
         s[1][2] + s[2][1]],
        [s[0][1] - s[1][0], s[2][0] + s[0][2], s[1][2] + s[2][1],
         s[2][2] - s[0][0] - s[1][1]]]


def largest_eigenvector(matrix):
    """Of a symmetric 4 x 4 matrix, by Jacobi rotations."""
    a = [list(row) for row in matrix]
    vectors = [[float(i == j) for j in range(4)] for i in range(4)]
    for _ in range(30):
        for p in range(3):
            for q in range(p + 1, 4):
                rotate(a, vectors, p, q)
    best = max(range(4), key=lambda i: a[i][i])
    return normalized([vectors[i][best] for i in range(4)])


def rotate(a, vectors, p, q):
    """A Jacobi rotation that sets a[p][q] to zero."""
    if a[p][q] == 0.0:
        return
    angle = 0.5 * math.atan2(2.0 * a[p][q], a[p][p] - a[q][q])
    c, s = math.cos(angle), math.sin(angle)
    for row in (*a, *vectors):
        row[p], row[q] = c * row[p] + s * row[q], c * row[q] - s * row[p]
    a[p], a[q] = ([c * x + s * y for x, y in zip(a[p], a[q])],
                  [c * y - s * x for x, y in zip(a[p], a[q])])


def errors(fit, model, truth):
    """(position error, rotation error in degrees) of each pose."""
    turn = poses.quaternion_from_rotation(fit.rotation)
    result = []
    for (q_model, center), (q_truth, target) in zip(model, truth):
        # cam_from_world of the model in the world of the truth.
        expected = multiply(q_model, conjugate(turn))
        cosine = min(1.0, abs(dot(expected, q_truth)))
        result.append((math.dist(fit.apply(center), target),
                       math.degrees(2.0 * math.acos(cosine))))
    return result


def multiply(a, b):
    """The product of two quaternions."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw)


def conjugate(q):
    """The inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


def normalized(q):
    """A vector of unit length."""
    length = math.sqrt(dot(q, q))
    return tuple(x / length for x in q)
