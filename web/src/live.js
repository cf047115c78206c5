// SPDX-License-Identifier: BSD-3-Clause
// A run in progress: asks the server that sent the page for its state, and for
// the model when there is another one (see report_page.h).

const INTERVAL_MS = 1000;
// A busy computer may not answer for a while.
const MAX_FAILURES = 5;

const byId = (id) => document.getElementById(id);

function formatTime(seconds) {
  const all = Math.max(0, Math.floor(seconds));
  const twoDigits = (x) => String(x).padStart(2, '0');
  return `${Math.floor(all / 3600)}:${twoDigits(Math.floor(all / 60) % 60)}:${twoDigits(all % 60)}`;
}

async function ask(path) {
  const response = await fetch(path, {cache: 'no-store'});
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return response.json();
}

export class LiveRun {
  // `onModel(model)` shows a model.
  constructor(onModel) {
    this.onModel = onModel;
    this.version = 0;
    this.numFailures = 0;
    this.lastElapsed_s = -1;
    byId('live').hidden = false;
    document.body.classList.add('live');
    this.poll();
  }

  async poll() {
    try {
      const state = await ask('state');
      this.numFailures = 0;
      if (state.finished) {
        location.reload();  // the page of the final model is in its place
        return;
      }
      this.showState(state);
      if (state.model_version !== this.version) {
        this.onModel(await ask('model'));
        this.version = state.model_version;
      }
    } catch (error) {
      if (++this.numFailures >= MAX_FAILURES) {
        byId('live_stage').textContent =
            'The run has ended, or was stopped. This is the last state of the model.';
        byId('live_share').hidden = true;
        return;
      }
    }
    setTimeout(() => this.poll(), INTERVAL_MS);
  }

  showState(state) {
    byId('live_stage').textContent = state.progress || state.stage || 'starting';
    const bar = byId('live_share');
    if (state.progress) {
      bar.value = state.share;
    } else {
      bar.removeAttribute('value');
    }
    // The server tells the time of the last event.
    if (state.elapsed_s !== this.lastElapsed_s) {
      this.lastElapsed_s = state.elapsed_s;
      this.lastChange_ms = performance.now();
    }
    const elapsed_s = state.elapsed_s + (performance.now() - this.lastChange_ms) / 1000;
    byId('live_time').textContent = `running for ${formatTime(elapsed_s)}`;
    if (state.messages.length === 0) return;
    byId('live_message').textContent = state.messages.at(-1);
    byId('live_messages').replaceChildren(...state.messages.slice(0, -1).reverse().map((text) => {
      const item = document.createElement('li');
      item.textContent = text;
      return item;
    }));
  }
}
