// SPDX-License-Identifier: BSD-3-Clause
// Colors of cameras and values, equal to those of charts (chart_parts.cc).

const SENSOR_COLORS = ['#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9',
                       '#d55e00', '#b8a800', '#7f6bb3'];

const NODES = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142],
               [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50],
               [253, 231, 37]];

export function sensorColor(order) {
  return SENSOR_COLORS[order % SENSOR_COLORS.length];
}

// [r, g, b] in [0, 1] for a value in [0, 1]; gray for NaN.
export function sequentialColor(value) {
  if (Number.isNaN(value)) return [0.55, 0.55, 0.55];
  const position = 8 * Math.min(Math.max(value, 0), 1);
  const node = Math.min(Math.floor(position), 7);
  const share = position - node;
  return [0, 1, 2].map(
      (c) => ((1 - share) * NODES[node][c] + share * NODES[node + 1][c]) / 255);
}

export function cssColor(rgb) {
  return `rgb(${rgb.map((c) => Math.round(255 * c)).join(' ')})`;
}

export function rgbOfHex(hex) {
  const value = parseInt(hex.slice(1), 16);
  return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
}

// The value that 95 % of the finite ones do not exceed.
export function usualMaximum(values) {
  const finite = Float64Array.from(values).filter(Number.isFinite).sort();
  if (finite.length === 0) return 1;
  return finite[Math.floor(0.95 * (finite.length - 1))] || 1;
}
