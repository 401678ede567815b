// Before anything is drawn: an address without columns has those that were chosen last.
"use strict";
const given = new URLSearchParams(location.search);
const columns = localStorage.getItem("columns");
if (columns && !given.has("column")) {
  columns.split("\n").forEach((name) => given.append("column", name));
  location.replace(`${location.pathname}?${given}`);
}
