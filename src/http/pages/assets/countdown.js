// Counts down to the times marked with data-until. Without this script, a page shows the time left at rendering.
"use strict";
const marked = [...document.querySelectorAll("time[data-until]")];
const told = (left) => {
  const s = Math.max(0, Math.floor(left / 1000));
  const units = [[Math.floor(s / 86400), "d"], [Math.floor(s / 3600) % 24, "h"], [Math.floor(s / 60) % 60, "min"], [s % 60, "s"]];
  const first = units.findIndex(([count]) => count > 0);
  return first < 0 ? "0 s" : units.slice(first, first + 2).map(([count, unit]) => `${count} ${unit}`).join(" ");
};
const show = () => marked.forEach((time) => { time.textContent = told(Date.parse(time.dateTime) - Date.now()); });
if (marked.length > 0) {
  show();
  setInterval(show, 1000);
}
