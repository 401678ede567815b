"use strict";
// The form for experiments: what is wrong is shown at its field, what was changed is marked and can be put back.
const form = document.getElementById("new");

function valueOf(field) {
  const boxes = [...field.querySelectorAll("input[type=checkbox]")].filter((box) => box.name.startsWith("set:"));
  if (field.querySelector("select")) return [field.querySelector("select").value, ...boxes.filter((box) => box.checked).map((box) => box.value)].join(",");
  if (boxes.length) return boxes.filter((box) => box.checked).map((box) => box.value).pop() ?? "false";
  return field.querySelector("input[type=text]").value.trim();
}

function mark(field) {
  const value = valueOf(field);
  field.classList.toggle("changed", value !== "" && value !== field.dataset.base);
}

form.addEventListener("input", (event) => {
  const field = event.target.closest(".field[data-base]");
  if (field) mark(field);
});

form.addEventListener("click", (event) => {
  const button = event.target.closest(".reset");
  if (!button) return;
  const field = button.closest(".field");
  const base = field.dataset.base;
  field.querySelectorAll("select, input[type=text]").forEach((input) => (input.value = base));
  field.querySelectorAll("input[type=checkbox]").forEach((box) => (box.checked = box.id !== "" && base === "true"));
  mark(field);
  field.dispatchEvent(new Event("input", { bubbles: true }));
});

form.addEventListener("keydown", (event) => {
  if (event.key !== "Enter" || event.target.matches("textarea, button, summary") && !event.ctrlKey) return;
  event.preventDefault(); // Enter in a field starts nothing
  if (event.ctrlKey || event.metaKey) document.getElementById("start").click();
});

// The field that a sentence is about: that of the setting, or of the component that holds it, or the free overrides.
function fieldOf(setting) {
  const name = setting.replace(/^[+~]+/, "");
  const typed = document.getElementById("more");
  if (typed.value.split("\n").some((line) => line.trim().replace(/^[+~]+/, "").startsWith(name))) return typed.closest(".field");
  for (let path = name; path; path = path.includes(".") ? path.slice(0, path.lastIndexOf(".")) : "") {
    const found = form.querySelector(`[data-setting="${CSS.escape(path)}"]`);
    if (found) return found;
  }
  return null;
}

document.body.addEventListener("htmx:afterSwap", (event) => {
  if (event.detail.target.id !== "outcome") return;
  form.querySelectorAll(".wrong").forEach((field) => field.classList.remove("wrong"));
  form.querySelectorAll(".why").forEach((why) => (why.hidden = true));
  form.querySelectorAll("[aria-invalid]").forEach((input) => input.removeAttribute("aria-invalid"));
  const refused = document.querySelector("#outcome [data-refused]");
  document.getElementById("start").disabled = refused !== null;
  const field = refused?.dataset.about ? fieldOf(refused.dataset.about) : null;
  if (!field) return;
  field.classList.add("wrong");
  const why = field.querySelector(".why");
  why.textContent = refused.dataset.refused;
  why.hidden = false;
  field.querySelector("input:not([type=hidden]), select, textarea")?.setAttribute("aria-invalid", "true");
  for (let above = field.parentElement; above; above = above.parentElement) if (above.matches("details")) above.open = true;
});
