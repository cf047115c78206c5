// SPDX-License-Identifier: BSD-3-Clause
// Two images of a cell of the view graph and the points that both see.
import {count, element, picture} from './details.js';

// The plot of ViewGraphChart() in model_charts.cc, in px of the drawing.
const LEFT = 60, TOP = 12, SIZE = 560;
const MAX_LINES = 200;

// The stored observations of an image, by point.
function observations({tracks, tracksOfImage: {starts, order}}, image) {
  return new Map(Array.from(order.subarray(starts[image], starts[image + 1]),
                            (i) => [tracks.point[i], i]));
}

// The images of two frames with the most stored points in common, as
// {images, pairs}; pairs of indices into data.tracks.
function bestPair(data, frames) {
  let best = {images: frames.map((frame) => data.imagesOfFrame[frame][0]), pairs: []};
  for (const first of data.imagesOfFrame[frames[0]]) {
    const seen = observations(data, first);
    for (const second of data.imagesOfFrame[frames[1]]) {
      if (second === first) continue;
      const pairs = [...observations(data, second)].filter(([point]) => seen.has(point))
                        .map(([point, i]) => [seen.get(point), i]);
      if (pairs.length > best.pairs.length) best = {images: [first, second], pairs};
    }
  }
  return best;
}

function showPair(photos, frames, root) {
  const {data} = photos;
  const {images, pairs} = bestPair(data, frames);
  root.replaceChildren();
  if (images.includes(undefined)) return;
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  svg.setAttribute('viewBox', '0 0 510 255');
  svg.setAttribute('preserveAspectRatio', 'none');
  const step = Math.ceil(pairs.length / MAX_LINES);
  for (let k = 0; k < pairs.length; k += step) {
    const [a, b] = pairs[k];
    const line = document.createElementNS('http://www.w3.org/2000/svg', 'line');
    const ends = {x1: data.tracks.x[a], y1: data.tracks.y[a],
                  x2: 255 + data.tracks.x[b], y2: data.tracks.y[b]};
    for (const [key, value] of Object.entries(ends)) line.setAttribute(key, value);
    svg.append(line);
  }
  const names = images.map((image) => data.imageNames[image]).join(' and ');
  root.append(
      element('div', {className: 'pictures'},
              [...images.map((image) => picture(photos, image, [])), svg]),
      element('p', {className: 'muted', textContent:
                    `${names}: ${count(pairs.length)} common points are stored in this page`}));
}

// Lets the view graph be clicked.
export function setUpPairs(photos) {
  const chart = document.querySelector('#view_graph svg');
  if (!chart) return;
  const root = element('div', {id: 'pair'});
  document.getElementById('pair')?.remove();
  chart.parentElement.after(root);
  chart.onclick = (event) => {
    const {x, y} = new DOMPoint(event.clientX, event.clientY)
                       .matrixTransform(chart.getScreenCTM().inverse());
    const frames = [(y - TOP) / SIZE, (x - LEFT) / SIZE].map(
        (share) => Math.floor(share * photos.data.numFrames));
    if (frames.every((frame) => frame in photos.data.imagesOfFrame)) showPair(photos, frames, root);
  };
}
