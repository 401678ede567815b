"use strict";
// Live updates: one stream of server-sent events a page, which names what changed; htmx fetches what is shown of it.
// A hidden page closes its stream, for a browser has six connections to a host.
let stream = null;

function listen() {
  if (stream || document.hidden) return;
  stream = new EventSource("/events");
  stream.addEventListener("changed", (event) => changed(event.data));
  stream.onopen = () => {
    if (!document.getElementById("offline").hidden) refresh();
    document.getElementById("offline").hidden = true;
  };
  stream.onerror = () => (document.getElementById("offline").hidden = false);
}

// A topic with a path in it, such as `run PATH`, is no name of an event that htmx could be told: its parts are sent `refresh`.
function changed(topic) {
  document.body.dispatchEvent(new CustomEvent(topic));
  document.querySelectorAll(`[data-topic="${CSS.escape(topic)}"]`).forEach((part) => htmx.trigger(part, "refresh"));
}

function refresh() {
  new Set([...document.querySelectorAll("[data-topic]")].map((part) => part.dataset.topic)).forEach(changed);
}

// What is loaded anew leaves open what was opened.
Idiomorph.defaults.callbacks.beforeAttributeUpdated = (name, node) => !(name === "open" && node.matches("details"));

document.addEventListener("visibilitychange", () => {
  if (document.hidden) {
    stream?.close();
    stream = null;
  } else {
    listen();
    refresh(); // what changed meanwhile
  }
});
listen();

// Light, dark, as the system.
document.getElementById("theme").addEventListener("click", () => {
  const next = { "": "light", light: "dark", dark: "" }[document.documentElement.dataset.theme ?? ""];
  if (next) document.documentElement.dataset.theme = next;
  else delete document.documentElement.dataset.theme;
  localStorage.setItem("theme", next);
});

// Copying commands.
document.addEventListener("click", async (event) => {
  const button = event.target.closest("[data-copy]");
  if (!button) return;
  await navigator.clipboard.writeText(button.dataset.copy);
  button.textContent = "Copied";
  setTimeout(() => (button.textContent = "Copy"), 1500);
});

// Keys: an element with data-key is focused (a field) or followed (a link, a button) by that key. j and k move through rows.
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, textarea, select")) return;
  const wanted = document.querySelector(`[data-key="${CSS.escape(event.key)}"]`);
  if (wanted) {
    event.preventDefault();
    if (wanted.matches("input")) wanted.focus();
    else wanted.click();
  } else if (event.key === "j" || event.key === "k") {
    const links = [...document.querySelectorAll("tbody tr a:first-of-type")];
    const at = links.indexOf(document.activeElement);
    links[event.key === "j" ? Math.min(at + 1, links.length - 1) : Math.max(at - 1, 0)]?.focus();
  }
});
