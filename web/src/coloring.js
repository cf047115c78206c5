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
      return byValue('points', arrays.image_num_points, (i) => i);
    case 'confidence':
      return {label: 'confidence', max: 1,
              colorOf: (i) => sequentialColor(arrays.frame_confidence[frameOf(i)])};
    case 'truth':
      return byValue('position error', arrays.truth_position_error, frameOf);
    case 'other':
      return byValue('position difference', arrays.other_position_error, frameOf);
    case 'time':
      return {label: 'frame', max: numFrames,
              colorOf: (i) => sequentialColor(frameOf(i) / numFrames)};
    default:
      return {colorOf: (i) => rgbOfHex(sensorColor(arrays.image_sensor[i])),
              names: header.sensors.map((s, i) => [s.name || 'images', sensorColor(i)])};
  }
}

// The same for points; `hasColors` states whether they have colors of images.
export function pointColoring(data, property, hasColors) {
  const {point_color: color, point_error: error, point_length: length} = data.arrays;
  switch (property) {
    case 'error':
      return {label: 'reprojection error [px]', max: 4,
              colorOf: (i) => sequentialColor(error[i] / 32 / 4)};
    case 'length':
      return {label: 'images per point', max: 20,
              colorOf: (i) => sequentialColor(length[i] / 20)};
    default:
      if (!hasColors) return {colorOf: () => [0.45, 0.5, 0.56]};
      return {colorOf: (i) => [color[3 * i] / 255, color[3 * i + 1] / 255,
                               color[3 * i + 2] / 255]};
  }
}
