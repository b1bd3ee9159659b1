// Virtual time: timers, the clock, and numbers that are the same in every run. Nothing sleeps. Called with a function that
// hears of every time at which a timer fires.
(function (heard) {
  "use strict";
  // Timers fire in the order of virtual time, and at equal times in the order in which they were set.
  let now = 0, next = 1;
  const timers = [];
  const set = (call, after, every, args) => {
    if (typeof call !== "function") throw new TypeError("a timer needs a function");
    const wait = Math.max(1, Math.trunc(Number(after)) || 0);
    const id = next++;
    timers.push({ id, at: now + wait, every: every ? wait : 0, call, args });
    return id;
  };
  const clear = (id) => {
    const place = timers.findIndex((timer) => timer.id === id);
    if (place >= 0) timers.splice(place, 1);
  };
  const fire = () => {
    if (!timers.length) return false;
    let first = 0;
    for (let i = 1; i < timers.length; i++) {
      const [a, b] = [timers[i], timers[first]];
      if (a.at < b.at || (a.at === b.at && a.id < b.id)) first = i;
    }
    const [timer] = timers.splice(first, 1);
    now = Math.max(now, timer.at);
    // Whoever hears of the time may end it.
    if (heard(now) === false) {
      timers.length = 0;
      return false;
    }
    if (timer.every) timers.push({ ...timer, at: now + timer.every });
    timer.call(...timer.args);
    return true;
  };
  const begin = (at) => { now = at; };

  // The same numbers in every run (mulberry32).
  let seed = 0x706c756d;
  Math.random = () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };

  // The clock is that of the timers and starts in 1970. Reading it advances it by a millisecond, so that busy waiting
  // ends.
  let looks = 0;
  const clock = () => now + looks++;
  const RealDate = Date;
  function VirtualDate(...args) {
    if (!new.target) return new RealDate(clock()).toString();
    return Reflect.construct(RealDate, args.length ? args : [clock()], new.target);
  }
  VirtualDate.prototype = RealDate.prototype;
  RealDate.prototype.constructor = VirtualDate;
  for (const name of ["parse", "UTC"])
    Object.defineProperty(VirtualDate, name, { value: RealDate[name], writable: true, configurable: true });
  Object.defineProperty(VirtualDate, "now", { value: clock, writable: true, configurable: true });
  Object.defineProperty(VirtualDate, "name", { value: "Date" });
  globalThis.Date = VirtualDate;

  const given = {
    setTimeout: (call, after, ...args) => set(call, after, false, args),
    setInterval: (call, after, ...args) => set(call, after, true, args),
    setImmediate: (call, ...args) => set(call, 0, false, args),
    clearTimeout: clear,
    clearInterval: clear,
  };
  for (const [name, value] of Object.entries(given)) globalThis[name] = value;
  const wait = (ms) => new Promise((done) => { set(done, ms, false, []); });
  return { fire, begin, wait };
});
