"use strict";
// Tables of runs and sweeps. What is out of sight is loaded anew only when it comes into sight: thousands of rows cost nothing.
{
  const inSight = (part) => {
    const { top, bottom } = part.getBoundingClientRect();
    return bottom >= 0 && top <= innerHeight;
  };
  document.addEventListener("refresh", ({ target }) => {
    if (!target.matches("tbody, tbody tr, #run-count")) return;
    if (inSight(target)) htmx.trigger(target, "show");
    else target.dataset.stale = "";
  });
  let waits = false;
  const scrolled = () => {
    waits = false;
    for (const part of document.querySelectorAll("[data-stale]")) {
      if (!inSight(part)) continue;
      delete part.dataset.stale;
      htmx.trigger(part, "show");
    }
  };
  addEventListener("scroll", () => {
    if (!waits) requestAnimationFrame(scrolled);
    waits = true;
  }, { passive: true });
}

// Ticks outlive filters, orders and pages.
{
  const ticked = new Set(JSON.parse(sessionStorage.getItem("ticked") ?? "[]"));
  const show = () => {
    const bar = document.getElementById("ticked");
    if (!bar) return;
    document.querySelectorAll("[data-tick]").forEach((box) => (box.checked = ticked.has(box.dataset.tick)));
    bar.hidden = ticked.size === 0;
    bar.querySelector("span").textContent = ticked.size === 1 ? "1 run ticked; tick another" : `${ticked.size} runs ticked`;
    const link = bar.querySelector("a");
    link.href = `/compare?${new URLSearchParams([...ticked].map((path) => ["run", path]))}`;
    link.hidden = ticked.size < 2;
  };
  const keep = () => {
    sessionStorage.setItem("ticked", JSON.stringify([...ticked]));
    show();
  };
  document.addEventListener("change", ({ target }) => {
    if (!target.matches("[data-tick]")) return;
    if (target.checked) ticked.add(target.dataset.tick);
    else ticked.delete(target.dataset.tick);
    keep();
  });
  document.addEventListener("click", ({ target }) => {
    if (!target.closest("#ticked button")) return;
    ticked.clear();
    keep();
  });
  document.addEventListener("htmx:afterSwap", show);
  show();
}

// Columns are remembered; the address has no more than it needs.
document.addEventListener("change", ({ target }) => {
  if (!target.matches("#columns input[type=checkbox]")) return;
  const chosen = new FormData(document.getElementById("filter")).getAll("column");
  const usual = document.getElementById("filter").dataset.default;
  if (chosen.length && chosen.join(" ") !== usual) localStorage.setItem("columns", chosen.join("\n"));
  else localStorage.removeItem("columns");
}, true);
document.addEventListener("htmx:configRequest", ({ detail, target }) => {
  if (target.id !== "filter") return;
  if (!detail.parameters.q) detail.formData.delete("q");
  if (detail.formData.get("sort") === "-started") detail.formData.delete("sort");
  if (detail.formData.getAll("column").join(" ") === target.dataset.default) detail.formData.delete("column");
});
document.addEventListener("input", ({ target }) => {
  if (!target.dataset.narrows) return;
  const word = target.value.toLowerCase();
  document.querySelectorAll(target.dataset.narrows).forEach((label) => (label.hidden = !label.textContent.toLowerCase().includes(word)));
});
// A menu closes when something else is clicked, or with Escape.
document.addEventListener("click", ({ target }) => {
  document.querySelectorAll("details.menu[open]").forEach((menu) => menu.contains(target) || (menu.open = false));
});
document.addEventListener("keydown", ({ key }) => {
  if (key === "Escape") document.querySelectorAll("details.menu[open]").forEach((menu) => (menu.open = false));
});
