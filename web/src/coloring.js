// SPDX-License-Identifier: BSD-3-Clause
// Colors of the cameras and points of a model by a property of theirs.
import {rgbOfHex, sensorColor, sequentialColor, usualMaximum} from './colors.js';

// {label, colorOf(image), max} or {names, colorOf(image)} for a property.
export function cameraColoring(data, property) {
  const {arrays, numFrames, header} = data;
  const byValue = (label, values, frameOf) => {
    const max = usualMaximum(values);
    return {label, max, colorOf: (i) => sequentialColor(values[frameOf(i)] / max)};
  };
  const frameOf = (image) => arrays.image_frame[image];
  switch (property) {
    case 'error':
      return byValue('mean reprojection error [px]', arrays.image_error_px, (i) => i);
    case 'points':
      return byValue('points per image', arrays.image_num_points, (i) => i);
    case 'confidence':
      return {label: 'confidence', max: 1,
              colorOf: (i) => sequentialColor(arrays.frame_confidence[frameOf(i)])};
    case 'truth':
      return byValue(`position error [${header.unit}]`, arrays.truth_position_error, frameOf);
    case 'measured':
      return byValue(`distance to measured position [${header.unit}]`,
                     arrays.measured_position_error, frameOf);
    case 'other':
      return byValue(`position difference [${header.unit}]`, arrays.other_position_error, frameOf);
    case 'time':
      return {label: 'frame', max: numFrames,
              colorOf: (i) => sequentialColor(frameOf(i) / numFrames)};
    default:
      return {colorOf: (i) => rgbOfHex(sensorColor(arrays.image_sensor[i])),
              names: header.sensors.map((s, i) => [s.name || 'images', sensorColor(i)])};
  }
}

// Above the lowest points but a few, along the vertical direction of the page.
function heights(data) {
  const {pointPositions: p, header: {up}} = data;
  const values = Float32Array.from(
      {length: p.length / 3}, (_, i) => up[0] * p[3 * i] + up[1] * p[3 * i + 1] + up[2] * p[3 * i + 2]);
  const low = values.slice().sort()[Math.floor(0.05 * values.length)];
  return values.map((value) => value - low);
}

// The same for points; without a property by the colors of the images.
export function pointColoring(data, property) {
  const {point_color: color, point_error: error, point_length: length} = data.arrays;
  const byValue = (label, values, unit) => {
    const max = usualMaximum(values);
    return {label, max: max * unit, colorOf: (i) => sequentialColor(values[i] / max)};
  };
  switch (property) {
    case 'error':
      return byValue('reprojection error [px]', error, 1 / 32);
    case 'length':
      return byValue('images per point', length, 1);
    case 'height':
      return byValue(`height [${data.header.unit}]`, heights(data), 1);
    default:
      return {colorOf: (i) => [color[3 * i] / 255, color[3 * i + 1] / 255,
                               color[3 * i + 2] / 255]};
  }
}
