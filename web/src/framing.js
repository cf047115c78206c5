// SPDX-License-Identifier: BSD-3-Clause
// From where a model is seen as a whole, and what lies below it.
import {Vector3} from 'three';

const FILLED = 0.86;  // of the panel, by what is framed
// From the side of a path, seen a bit along it and from above.
const AZIMUTH_RAD = 0.5, ELEVATION_RAD = 0.6;
const MAX_SAMPLES = 5000;

// Positions with finite coordinates in the shown part of space, which has a
// radius of 1, at equal steps.
function shownPositions(array) {
  const positions = [];
  const step = 3 * Math.max(1, Math.ceil(array.length / 3 / MAX_SAMPLES));
  for (let i = 0; i < array.length; i += step) {
    const place = new Vector3().fromArray(array, i);
    if (place.length() <= 1.001) positions.push(place);
  }
  return positions;
}

const quantile = (sorted, share) => sorted[Math.round(share * (sorted.length - 1))];

// The corners of the box of the middle half of the positions.
function middleBox(positions) {
  const ends = ['x', 'y', 'z'].map((axis) => {
    const values = positions.map((place) => place[axis]).sort((a, b) => a - b);
    return [quantile(values, 0.25), quantile(values, 0.75)];
  });
  return [0, 1, 2, 3, 4, 5, 6, 7].map(
      (i) => new Vector3(...ends.map((end, axis) => end[(i >> axis) & 1])));
}

const meanOf = (positions) => positions.reduce((sum, p) => sum.add(p), new Vector3())
                                  .divideScalar(Math.max(positions.length, 1));

// The horizontal direction in which the positions extend most, from the first
// to the last one.
function principalAxis(positions, middle, up) {
  const right = new Vector3(0.3, 0.7, -0.6).cross(up).normalize();
  const ahead = up.clone().cross(right);
  let xx = 0, xy = 0, yy = 0;
  for (const position of positions) {
    const offset = position.clone().sub(middle);
    const x = offset.dot(right), y = offset.dot(ahead);
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  const angle = 0.5 * Math.atan2(2 * xy, xx - yy);
  const axis = right.multiplyScalar(Math.cos(angle)).addScaledVector(ahead, Math.sin(angle));
  const travel = positions.length > 0 ? positions[positions.length - 1].clone().sub(positions[0]) : up;
  return travel.dot(axis) < 0 ? axis.negate() : axis;
}

// {framed, middle, along, radius, ground, spacing} of a path and points:
// what a view of the whole model has to show, the mean and main direction of
// that, its extent, the height below, and the usual distance between neighboring
// points. Points count where they are farther apart than the path is long.
export function measureModel(path, points, up, minRadius) {
  const places = shownPositions(path), cloud = shownPositions(points);
  let framed = places;
  if (cloud.length > 7) {
    const box = middleBox(cloud);
    const middle = meanOf(places);
    const length = Math.max(0, ...places.map((place) => 2 * place.distanceTo(middle)));
    if (box[0].distanceTo(box[7]) > length) framed = [...places, ...box];
  }
  const middle = meanOf(framed);
  const along = principalAxis(places.length > 1 ? places : framed, middle, up);
  const radius = Math.max(minRadius, ...framed.map((place) => place.distanceTo(middle)));
  const heights = (cloud.length > 0 ? cloud : framed).map((place) => place.dot(up))
                      .sort((a, b) => a - b);
  const ground = heights.length > 0 ? quantile(heights, 0.1) : 0;
  return {framed, middle, along, radius, ground, spacing: spacingOf(cloud, points.length / 3)};
}

// The median distance to the nearest point, of a sample, as if points lay on
// surfaces: then it falls with the root of their number.
function spacingOf(cloud, numPoints) {
  const nearest = [];
  for (let i = 0; i < cloud.length; i += Math.ceil(cloud.length / 100)) {
    let best = Infinity;
    for (let j = 0; j < cloud.length; ++j) {
      if (j !== i) best = Math.min(best, cloud[i].distanceToSquared(cloud[j]));
    }
    nearest.push(Math.sqrt(best));
  }
  nearest.sort((a, b) => a - b);
  return nearest.length > 1 ? quantile(nearest, 0.5) * Math.sqrt(cloud.length / numPoints) : 0;
}

// The directions from the middle of the model to a viewer: from the side and
// above, such that its main direction goes to the right, or from above.
export function sideDirection({along}, up) {
  return along.clone().cross(up).applyAxisAngle(up, -AZIMUTH_RAD)
      .multiplyScalar(Math.cos(ELEVATION_RAD)).addScaledVector(up, Math.sin(ELEVATION_RAD));
}

export function topDirection({along}, up) {
  return along.clone().cross(up).multiplyScalar(1e-3).add(up).normalize();
}

// {target, distance} of a perspective view from `direction` that all positions
// fill. `tangents` are those of half the fields of view.
export function fitView(positions, middle, direction, up, tangents, minDistance) {
  const right = up.clone().cross(direction).normalize();
  const axes = [right, direction.clone().cross(right)];
  const target = middle.clone();
  let distance = minDistance;
  for (let round = 0; round < 4; ++round) {
    const offsets = positions.map((position) => {
      const offset = position.clone().sub(target);
      return {depth: offset.dot(direction), sides: axes.map((axis) => offset.dot(axis))};
    });
    distance = minDistance;
    for (const {depth, sides} of offsets) {
      sides.forEach((side, c) => {
        distance = Math.max(distance, depth + Math.abs(side) / (FILLED * tangents[c]));
      });
    }
    axes.forEach((axis, c) => {
      const shares = offsets.map(({depth, sides}) => sides[c] / (distance - depth));
      if (shares.length === 0) return;
      const [low, high] = shares.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)],
                                        [Infinity, -Infinity]);
      target.addScaledVector(axis, 0.5 * (low + high) * distance);
    });
  }
  return {target, distance};
}

// The largest 1, 2 or 5 times a power of ten that is not above the value.
export function roundLength(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return ([5, 2].find((digit) => digit * power <= value) ?? 1) * power;
}
