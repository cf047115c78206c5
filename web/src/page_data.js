// SPDX-License-Identifier: BSD-3-Clause
// Reads what src/addons/report_page/scene_data.cc writes.

const ARRAY_TYPES = {
  f32: Float32Array,
  i16: Int16Array,
  u8: Uint8Array,
  u32: Uint32Array,
};

function decodeBase64(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

// [shared, suffix, ...] to names; see FrontCode in encoding.h.
function decodeNames(coded) {
  const names = [];
  let last = '';
  for (let i = 0; i < coded.length; i += 2) {
    last = last.slice(0, coded[i]) + coded[i + 1];
    names.push(last);
  }
  return names;
}

// Positions relative to the origin of the page.
function decodePoints(packed, boxMin, boxSize) {
  const numPoints = packed.length / 2;
  const positions = new Float32Array(3 * numPoints);
  const step = boxSize.map((size) => size / ((1 << 21) - 1));
  for (let i = 0; i < numPoints; ++i) {
    const low = packed[2 * i];
    const high = packed[2 * i + 1];
    positions[3 * i] = boxMin[0] + step[0] * (low & 0x1fffff);
    positions[3 * i + 1] =
        boxMin[1] + step[1] * ((low >>> 21) | ((high & 0x3ff) << 11));
    positions[3 * i + 2] = boxMin[2] + step[2] * (high >>> 10);
  }
  return positions;
}

// The observations of all stored tracks, as parallel arrays sorted by point.
function decodeTracks(bytes, numTracks) {
  const starts = new Uint32Array(numTracks + 1);
  const point = [], image = [], x = [], y = [], error = [];
  let at = 0;
  const readVarint = () => {
    let value = 0;
    for (let shift = 0; ; shift += 7) {
      const byte = bytes[at++];
      value |= (byte & 0x7f) << shift;
      if (byte < 0x80) return value >>> 0;
    }
  };
  for (let i = 0; i < numTracks; ++i) {
    const length = readVarint();
    let last = 0;
    for (let k = 0; k < length; ++k) {
      last += readVarint();
      point.push(i);
      image.push(last);
      x.push(bytes[at++]);
      y.push(bytes[at++]);
      error.push(bytes[at++]);
    }
    starts[i + 1] = point.length;
  }
  return {starts, point, image, x, y, error};
}

// Observations of each image: order[starts[i]] to order[starts[i + 1] - 1].
function groupByImage(tracks, numImages) {
  const starts = new Uint32Array(numImages + 1);
  for (const image of tracks.image) ++starts[image + 1];
  for (let i = 0; i < numImages; ++i) starts[i + 1] += starts[i];
  const next = starts.slice();
  const order = new Uint32Array(tracks.image.length);
  tracks.image.forEach((image, i) => { order[next[image]++] = i; });
  return {starts, order};
}

function collectThumbnails(arrays) {
  const thumbnails = new Map();
  let at = 0;
  arrays.thumbnail_image.forEach((image, i) => {
    const size = arrays.thumbnail_size[i];
    thumbnails.set(image, arrays.thumbnail_jpeg.subarray(at, at + size));
    at += size;
  });
  return thumbnails;
}

// The typed arrays of a directory {name: [type, offset, size]} in base64.
function readArrays(directory, base64) {
  const bytes = decodeBase64(base64);
  const arrays = {};
  for (const [name, [type, offset, size]] of Object.entries(directory)) {
    arrays[name] = new ARRAY_TYPES[type](bytes.buffer, offset, size);
  }
  return arrays;
}

function concatenate(parts) {
  const size = parts.reduce((sum, part) => sum + part.length, 0);
  const all = new parts[0].constructor(size);
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all;
}

// Adds the points of side files, [{arrays, base64}].
export function addSidePoints(data, files) {
  const {arrays, header} = data;
  const more = files.map((file) => readArrays(file.arrays, file.base64));
  for (const name of ['point_position', 'point_color', 'point_error', 'point_length']) {
    arrays[name] = concatenate([arrays[name], ...more.map((part) => part[name])]);
  }
  data.pointPositions =
      decodePoints(arrays.point_position, header.box_min, header.box_size);
}

// `header` is an object, `base64` has the arrays that it lists.
export function readPageData(header, base64) {
  const arrays = readArrays(header.arrays, base64);
  const tracks = decodeTracks(arrays.tracks, arrays.num_tracks[0]);
  const numImages = arrays.image_frame.length;
  const numFrames = arrays.frame_reason.length;
  const imagesOfFrame = Array.from({length: numFrames}, () => []);
  arrays.image_frame.forEach((frame, i) => imagesOfFrame[frame].push(i));
  return {
    header,
    arrays,
    numImages,
    numFrames,
    imagesOfFrame,
    frameNames: decodeNames(header.frame_names),
    imageNames: decodeNames(header.image_names),
    pointPositions:
        decodePoints(arrays.point_position, header.box_min, header.box_size),
    tracks,
    tracksOfImage: groupByImage(tracks, numImages),
    thumbnails: collectThumbnails(arrays),
  };
}

export function isRegistered(data, frame) {
  return !Number.isNaN(data.arrays.frame_center[3 * frame]);
}
