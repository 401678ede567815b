"use strict";
// The Rerun viewer on a page of its own: it shows the recording that the page names, and keeps nothing.
console.debug = () => {}; // of which the viewer says thousands of lines
const state = document.getElementById("viewer-state");
const canvas = document.getElementById("viewer-canvas");
const { recording, program } = document.body.dataset;
const theme = document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");

// The viewer asks without cookies, which a recording may need, and reports to its makers, which is not wanted here.
const ask = window.fetch.bind(window);
window.fetch = (what, how) => {
  const request = new Request(what, { ...how, credentials: "same-origin" });
  if (request.url.startsWith(`${location.origin}/`)) return ask(request);
  return Promise.reject(new TypeError(`${new URL(request.url).host} is not asked`));
};

function failed(error) {
  canvas.remove();
  state.hidden = false;
  state.textContent = `The viewer does not run in this browser (${error}); on this machine there is also: omnilab view`;
}

async function show() {
  await wasm_bindgen({ module_or_path: fetch(program) });
  const viewer = new wasm_bindgen.WebHandle({
    url: [new URL(recording, location).href],
    render_backend: "webgl", // which every browser has, also without a graphics card
    hide_welcome_screen: true,
    enable_history: false,
    notebook: false,
    persist: false,
    theme,
  });
  await viewer.start(canvas);
  viewer.override_panel_state("top", "hidden");
  state.hidden = true;
  const watch = setInterval(() => {
    if (!viewer.has_panicked()) return;
    clearInterval(watch);
    failed(viewer.panic_message());
  }, 1000);
}

show().catch(failed);
