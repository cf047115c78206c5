// SPDX-License-Identifier: BSD-3-Clause
// Loads the points that lie in files beside the page. These are scripts, because
// a page from a file may not read others.

function loadScript(name) {
  return new Promise((resolve, reject) => {
    const script = document.createElement('script');
    script.src = encodeURIComponent(name);
    script.onload = resolve;
    script.onerror = () => reject(new Error(`${name} is missing`));
    document.head.append(script);
  });
}

// [{arrays, base64}] for addSidePoints(). `onProgress(numLoaded)`.
export async function loadSideFiles(sidePoints, onProgress) {
  const files = [];
  window.mgsfmSidePoints = (header, base64) => {
    if (header.id !== sidePoints.id || header.index !== files.length) {
      throw new Error('the files of points belong to another page');
    }
    files.push({arrays: header.arrays, base64});
  };
  for (const [i, name] of sidePoints.names.entries()) {
    onProgress(i);
    await loadScript(name);
    if (files.length !== i + 1) throw new Error(`${name} belongs to another page`);
  }
  return files;
}
