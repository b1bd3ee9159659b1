// Vectors with the interface of the npm package vec3 0.2.0. Called with the function that takes notes.
(function (note) {
  function Vec3(x, y, z) {
    if (!new.target) {
      note("Vec3 was called without `new`, which fails in mindcraft");
      return parse(x, y, z);
    }
    this.x = x; this.y = y; this.z = z;
  }
  // Reads nothing, an array, an object with x, y and z, a text such as "(1, 2, 3)", or three numbers.
  function parse(x, y, z) {
    const of = (...parts) => new Vec3(...parts.map(parseFloat));
    if (x === undefined || x === null) return new Vec3(0, 0, 0);
    if (Array.isArray(x)) return of(x[0], x[1], x[2]);
    if (typeof x === "object") return of(x.x, x.y, x.z);
    if (typeof x === "string" && (y === undefined || y === null)) {
      const parts = /\((-?[.\d]+), (-?[.\d]+), (-?[.\d]+)\)/.exec(x);
      if (!parts) throw new Error(`vec3: cannot parse: ${x}`);
      return of(parts[1], parts[2], parts[3]);
    }
    return of(x, y, z);
  }
  const axes = ["x", "y", "z"];
  // Applies a function to each coordinate, with those of others beside it.
  const each = (into, apply, ...others) => {
    for (const axis of axes) into[axis] = apply(into[axis], ...others.map((other) => other[axis]));
    return into;
  };
  const copy = (of) => new Vec3(of.x, of.y, of.z);
  const length = (...parts) => Math.sqrt(parts.reduce((sum, part) => sum + part * part, 0));
  const modulo = (a, b) => (a % b < 0 ? (a % b) + b : a % b);
  const dot = (a, b) => a.x * b.x + a.y * b.y + a.z * b.z;
  const methods = {
    isZero() { return this.x === 0 && this.y === 0 && this.z === 0; },
    at(i) { return this.toArray()[i]; },
    xz() { return [this.x, this.z]; },
    xy() { return [this.x, this.y]; },
    yz() { return [this.y, this.z]; },
    xzy() { return new Vec3(this.x, this.z, this.y); },
    set(x, y, z) { this.x = x; this.y = y; this.z = z; return this; },
    update(other) { return this.set(other.x, other.y, other.z); },
    rounded() { return copy(this).round(); },
    round() { return each(this, Math.round); },
    floored() { return copy(this).floor(); },
    floor() { return each(this, Math.floor); },
    offset(dx, dy, dz) { return new Vec3(this.x + dx, this.y + dy, this.z + dz); },
    translate(dx, dy, dz) { return this.set(this.x + dx, this.y + dy, this.z + dz); },
    add(other) { return each(this, (a, b) => a + b, other); },
    subtract(other) { return each(this, (a, b) => a - b, other); },
    multiply(other) { return each(this, (a, b) => a * b, other); },
    divide(other) { return each(this, (a, b) => a / b, other); },
    plus(other) { return this.offset(other.x, other.y, other.z); },
    minus(other) { return this.offset(-other.x, -other.y, -other.z); },
    scaled(by) { return copy(this).scale(by); },
    scale(by) { return each(this, (a) => a * by); },
    abs() { return each(copy(this), Math.abs); },
    volume() { return this.x * this.y * this.z; },
    modulus(other) { return each(copy(this), modulo, other); },
    angleTo(other) {
      note("Vec3.angleTo exists from vec3 0.2.0 on, and mindcraft asks for 0.1.10");
      return Math.acos(dot(this, other) / (this.norm() * other.norm()));
    },
    distanceTo(other) { return length(other.x - this.x, other.y - this.y, other.z - this.z); },
    distanceSquared(other) {
      const [dx, dy, dz] = [other.x - this.x, other.y - this.y, other.z - this.z];
      return dx * dx + dy * dy + dz * dz;
    },
    equals(other, error = 0) { return axes.every((axis) => Math.abs(this[axis] - other[axis]) <= error); },
    toString() { return `(${this.x}, ${this.y}, ${this.z})`; },
    clone() { return copy(this); },
    min(other) { return each(copy(this), (a, b) => Math.min(a, b), other); },
    max(other) { return each(copy(this), (a, b) => Math.max(a, b), other); },
    norm() { return length(this.x, this.y, this.z); },
    dot(other) { return dot(this, other); },
    innerProduct(other) { return dot(this, other); },
    cross(other) {
      return new Vec3(
        this.y * other.z - this.z * other.y, this.z * other.x - this.x * other.z, this.x * other.y - this.y * other.x);
    },
    unit() { const norm = this.norm(); return norm === 0 ? copy(this) : this.scaled(1 / norm); },
    normalize() {
      const norm = this.norm();
      return norm === 0 ? this : each(this, (a) => a / norm);
    },
    xyDistanceTo(other) { return length(other.x - this.x, other.y - this.y); },
    xzDistanceTo(other) { return length(other.x - this.x, other.z - this.z); },
    yzDistanceTo(other) { return length(other.y - this.y, other.z - this.z); },
    manhattanDistanceTo(other) { return axes.reduce((sum, axis) => sum + Math.abs(other[axis] - this[axis]), 0); },
    toArray() { return [this.x, this.y, this.z]; },
  };
  for (const [name, value] of Object.entries(methods))
    Object.defineProperty(Vec3.prototype, name, { value, writable: true, configurable: true });
  const vec3 = function vec3(x, y, z) { return parse(x, y, z); };
  vec3.Vec3 = Vec3;
  return { Vec3, vec3 };
});
