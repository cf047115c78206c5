// SPDX-License-Identifier: BSD-3-Clause
// Pictures of images: the photo from the folder of images while that can be
// reached, else the thumbnail of the page.

export class Photos {
  constructor(data) {
    this.data = data;
    this.urls = new Map();  // of thumbnails
    this.folder = data.header.image_url ?? null;
  }

  dispose() {
    for (const url of this.urls.values()) URL.revokeObjectURL(url);
  }

  // The image whose thumbnail stands for this one: itself or, if it has none,
  // the nearest in time of the same camera. undefined if there is none.
  nearest(image) {
    const {thumbnails, arrays} = this.data;
    if (thumbnails.has(image)) return image;
    const {image_frame: frames, image_sensor: sensors} = arrays;
    let best, bestDistance = Infinity;
    for (const other of thumbnails.keys()) {
      const distance = Math.abs(frames[other] - frames[image]);
      if (sensors[other] !== sensors[image] || distance >= bestDistance) continue;
      best = other;
      bestDistance = distance;
    }
    return best;
  }

  thumbnailUrl(image) {
    if (!this.urls.has(image)) {
      this.urls.set(image, URL.createObjectURL(
          new Blob([this.data.thumbnails.get(image)], {type: 'image/jpeg'})));
    }
    return this.urls.get(image);
  }

  // Shows an image in an <img>; onShown(image) tells which one it is, undefined
  // if there is none. For a small one, its own thumbnail suffices.
  show(node, image, isSmall, onShown) {
    const shown = this.nearest(image);
    const useThumbnail = () => {
      if (shown === undefined) node.removeAttribute('src');
      else node.src = this.thumbnailUrl(shown);
      onShown(shown);
    };
    if (this.folder === null || (isSmall && shown === image)) {
      useThumbnail();
      return;
    }
    node.onerror = () => {
      node.onerror = null;
      this.folder = null;
      useThumbnail();
    };
    onShown(image);
    node.src = (this.folder + this.data.imageNames[image]).split('/').map(encodeURIComponent).join('/');
  }
}
