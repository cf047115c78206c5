// SPDX-License-Identifier: BSD-3-Clause
// What is known about the selected camera or point. All names are data: they
// only become text, never markup.
import {cssColor, sequentialColor, usualMaximum} from './colors.js';

const MAX_PICTURES = 12;

export function element(tag, properties = {}, children = []) {
  const node = document.createElement(tag);
  Object.assign(node, properties);
  node.append(...children);
  return node;
}

function name(text) {
  return element('bdi', {textContent: text});
}

function table(rows) {
  const body = element('tbody');
  for (const [label, value] of rows) {
    const content = typeof value === 'string' ? name(value) : value;
    body.append(element('tr', {}, [
      element('th', {scope: 'row', textContent: label}),
      element('td', {}, [content]),
    ]));
  }
  return element('table', {}, [body]);
}

export const count = (value) => value.toLocaleString('en');

export function formatNumber(value, digits = 4) {
  return Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : '–';
}

// The errors of observations are stored in 1/32 px; 255 stands for more.
const ERROR_STEPS_PER_PX = 32;

// What most errors do not exceed, the end of the color scale, in px.
export function usualErrorPx(data) {
  data.usualErrorPx ??= usualMaximum(data.tracks.error) / ERROR_STEPS_PER_PX;
  return data.usualErrorPx;
}

// A picture of an image with marks {x, y, error, radius} at fractions of its
// size. They are only shown on the image itself, of which onShown(image) tells.
export function picture(photos, image, marks, onShown = () => {}, isSmall = false) {
  const {data} = photos;
  const sensor = data.header.sensors[data.arrays.image_sensor[image]];
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  svg.setAttribute('viewBox', `0 0 ${sensor.width_px} ${sensor.height_px}`);
  for (const mark of marks) {
    const dot = document.createElementNS('http://www.w3.org/2000/svg', 'circle');
    dot.setAttribute('cx', mark.x / 255 * sensor.width_px);
    dot.setAttribute('cy', mark.y / 255 * sensor.height_px);
    dot.setAttribute('r', mark.radius * sensor.width_px);
    dot.setAttribute('fill', cssColor(sequentialColor(
        mark.error / ERROR_STEPS_PER_PX / usualErrorPx(data))));
    dot.setAttribute('stroke', '#0008');
    dot.setAttribute('stroke-width', 0.002 * sensor.width_px);
    svg.append(dot);
  }
  const node = element('img', {alt: data.imageNames[image]});
  photos.show(node, image, isSmall, (shown) => {
    svg.style.display = shown === image ? '' : 'none';
    onShown(shown);
  });
  node.style.aspectRatio = `${sensor.width_px} / ${sensor.height_px}`;
  return element('div', {className: 'picture'}, [node, svg]);
}

// The marks of the stored observations of an image.
export function marksOf(data, image) {
  const {tracks, tracksOfImage: {starts, order}} = data;
  const radius = starts[image + 1] - starts[image] > 500 ? 0.0035 : 0.006;
  return Array.from(order.subarray(starts[image], starts[image + 1]),
                    (i) => ({x: tracks.x[i], y: tracks.y[i], error: tracks.error[i], radius}));
}

// The images of a frame, each a button.
export function frameImages(photos, frame, onSelect) {
  const {data} = photos;
  return (data.imagesOfFrame[frame] ?? []).slice(0, MAX_PICTURES).map((image) => {
    const sensor = data.header.sensors[data.arrays.image_sensor[image]];
    const caption = element('figcaption', {}, [name(sensor.name || data.imageNames[image])]);
    const button = element('button', {type: 'button', title: data.imageNames[image]});
    button.append(picture(photos, image, [], (shown) => {
      button.hidden = shown === undefined;
      button.classList.toggle('other', shown !== image);
    }, true));
    button.addEventListener('click', () => onSelect({image}));
    return element('figure', {}, [button, caption]);
  });
}

export class Details {
  // `onSelect` receives {image}, {point} or null.
  constructor(root, photos, view, onSelect) {
    Object.assign(this, {root, photos, data: photos.data, view, onSelect});
  }

  show(selection) {
    this.root.replaceChildren();
    if (!selection) return;
    const close = element('button', {type: 'button', textContent: '×', title: 'close (Esc)'});
    close.className = 'close';
    close.addEventListener('click', () => this.onSelect(null));
    this.root.append(close);
    if (selection?.image !== undefined) this.showCamera(selection.image);
    if (selection?.point !== undefined) this.showPoint(selection.point);
  }

  showCamera(image) {
    const {data, view} = this;
    const {arrays} = data;
    const marks = marksOf(data, image);
    const caption = element('figcaption');
    const figure = element('figure');
    figure.append(picture(this.photos, image, marks, (shown) => {
      figure.hidden = shown === undefined;
      caption.replaceChildren(...(shown === image ?
          [`${count(marks.length)} of ${count(arrays.image_num_points[image])} points; color: error, ` +
           `0 to ${formatNumber(usualErrorPx(data), 2)} px`] :
          ['nearest thumbnail of this camera: ', name(data.imageNames[shown] ?? '')]));
    }), caption);
    this.root.append(figure);
    const frame = arrays.image_frame[image];
    const pose = view.poses.camera(image);
    const rows = [
      ['image', data.imageNames[image]],
      ['camera', data.header.sensors[arrays.image_sensor[image]].name],
      ['frame', `${count(frame * data.header.frame_step)}: ${data.frameNames[frame]}`],
      ['points', count(arrays.image_num_points[image])],
      ['mean error', `${formatNumber(arrays.image_error_px[image], 3)} px`],
    ];
    if (pose) {
      const position = view.poses.toWorld(pose.center).toArray();
      rows.push(['position', `${position.map((x) => formatNumber(x, 6)).join(', ')} ${data.header.unit}`]);
    }
    this.addErrors('truth', 'error of the frame', frame, rows);
    this.addErrors('measured', 'distance to the measured position', frame, rows);
    this.addErrors('other', 'difference of the frame', frame, rows);
    const look = element('button', {type: 'button', textContent: 'look through'});
    look.addEventListener('click', () => view.lookThrough(image));
    this.root.append(table(rows), look);
  }

  addErrors(prefix, label, frame, rows) {
    const positions = this.data.arrays[`${prefix}_position_error`];
    if (!positions || !Number.isFinite(positions[frame])) return;
    const rotation = this.data.arrays[`${prefix}_rotation_error_deg`][frame];
    rows.push([label, `${formatNumber(positions[frame])} ${this.data.header.unit}` +
        (prefix === 'measured' ? '' : `, ${formatNumber(rotation, 3)}°`)]);
  }

  showPoint(point) {
    const {data, view} = this;
    const {arrays, tracks} = data;
    const track = view.trackOf(point);
    const position = view.poses.toWorld(view.poses.point(point)).toArray();
    const error = arrays.point_error[point] / 32;
    this.root.append(table([
      ['point', `${position.map((x) => formatNumber(x, 6)).join(', ')} ${data.header.unit}`],
      ['images', count(arrays.point_length[point])],
      ['mean error', `${error >= 255 / 32 ? '8 or more' : formatNumber(error, 2)} px`],
      ...(track.length > 0 ? [] : [['track', 'not stored in this page']]),
    ]));
    const list = element('div', {className: 'track'});
    for (const k of track) {
      const image = tracks.image[k];
      const caption = element('button', {type: 'button', title: data.imageNames[image]},
                              [name(data.imageNames[image])]);
      caption.addEventListener('click', () => this.onSelect({image}));
      const error = tracks.error[k];
      const parts = [element('figcaption', {}, [
        caption, ` ${error === 255 ? '8 or more' : formatNumber(error / 32, 2)} px`])];
      if ((data.thumbnails.has(image) || this.photos.folder !== null) && list.children.length < MAX_PICTURES) {
        const mark = {x: tracks.x[k], y: tracks.y[k], error, radius: 0.02};
        parts.unshift(picture(this.photos, image, [mark], undefined, true));
      }
      list.append(element('figure', {}, parts));
    }
    this.root.append(list);
  }
}
