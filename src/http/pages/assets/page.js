// What pages do beyond showing: countdowns run, texts are copied, and what is under way is kept up to date. Without this
// script, a page shows everything as it was when it was loaded.
"use strict";

// Countdowns: time elements marked with data-until.
const marked = [...document.querySelectorAll("time[data-until]")];
const left = (ms) => {
  const s = Math.max(0, Math.floor(ms / 1000));
  const units = [[Math.floor(s / 86400), "d"], [Math.floor(s / 3600) % 24, "h"], [Math.floor(s / 60) % 60, "min"], [s % 60, "s"]];
  const first = units.findIndex(([count]) => count > 0);
  return first < 0 ? "0 s" : units.slice(first, first + 2).map(([count, unit]) => `${count} ${unit}`).join(" ");
};
const tick = () => marked.forEach((time) => { time.textContent = left(Date.parse(time.dateTime) - Date.now()); });
if (marked.length > 0) {
  tick();
  setInterval(tick, 1000);
}

// Texts marked with data-copy get a button. Where the browser refuses, the text is selected, to be copied by hand.
for (const text of document.querySelectorAll("[data-copy]")) {
  const button = document.createElement("button"), told = document.createElement("span");
  Object.assign(button, { type: "button", className: "copy", textContent: "Copy" });
  button.setAttribute("aria-label", `Copy: ${text.getAttribute("aria-label") ?? "text"}`);
  told.setAttribute("role", "status");
  told.className = "soft";
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(text.textContent);
      told.textContent = " Copied";
    } catch {
      getSelection().selectAllChildren(text);
      told.textContent = " Selected: copy it with the keyboard";
    }
    setTimeout(() => { told.textContent = ""; }, 4000);
  });
  text.after(button, told);
}

// A part marked with data-live follows the events of its URL while the page is seen: after an event, and every data-every
// seconds, it is taken anew from the server. When the server no longer marks it, what was under way has ended, and the page is
// loaded again. Without a stream, the server is asked every half minute.
const live = document.querySelector("[data-live]");
const PAUSE = 2000, SELDOM = 30000;
let shown = live?.innerHTML, due = null, last = Date.now(), isBusy = false, isWanted = false, events = null;

/* Says which link or family an element is, to find it again after the part was taken anew. */
const nameOf = (element) => element?.getAttribute("href") ?? element?.querySelector(".name")?.textContent;

function replace(fresh) {
  if (fresh.innerHTML === shown) return;
  shown = fresh.innerHTML;
  const open = new Set([...live.querySelectorAll("details[open] .name")].map((name) => name.textContent));
  const focused = live.contains(document.activeElement) ? nameOf(document.activeElement) : null;
  live.replaceChildren(...fresh.childNodes);
  for (const name of live.querySelectorAll("details .name")) name.closest("details").open = open.has(name.textContent);
  if (focused) [...live.querySelectorAll("a, summary")].find((element) => nameOf(element) === focused)?.focus({ preventScroll: true });
}

async function renew() {
  due = null;
  if (isBusy) {
    isWanted = true;
    return;
  }
  [isBusy, last] = [true, Date.now()];
  try {
    const answer = await fetch(location.href, { headers: { accept: "text/html" } });
    if (!answer.ok) return;
    const fresh = new DOMParser().parseFromString(await answer.text(), "text/html").querySelector("[data-live]");
    if (fresh) replace(fresh);
    else location.reload();
  } catch { /* The network is away: the next event or the next turn asks again. */ } finally {
    isBusy = false;
    if (isWanted) {
      isWanted = false;
      soon();
    }
  }
}
function soon() { due ??= setTimeout(renew, Math.max(0, last + PAUSE - Date.now())); }

function follow() {
  if (document.hidden) {
    events?.close();
    events = null;
  } else if (!events || events.readyState === EventSource.CLOSED) {
    events = new EventSource(live.dataset.live);
    for (const name of ["submission", "run"]) events.addEventListener(name, soon);
  }
}
if (live) {
  follow();
  document.addEventListener("visibilitychange", () => { follow(); if (!document.hidden) soon(); });
  addEventListener("pagehide", () => { events?.close(); events = null; });
  addEventListener("pageshow", (event) => { if (event.persisted) { follow(); soon(); } });
  const every = Number(live.dataset.every) * 1000;
  setInterval(() => { if (!document.hidden && (every || !events || events.readyState === EventSource.CLOSED)) soon(); }, every || SELDOM);
}
