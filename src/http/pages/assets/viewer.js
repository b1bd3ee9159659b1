// The 3D view of builds: draws the visible faces in one call, with replay, slices, materials, stress and flagged blocks.
// A view is a .viewer element that contains its scene as JSON. Views with the same data-camera rotate together. Checks
// beside a view (details.check in the same [data-shown]) show the blocks that they flag when they are opened.
const SIDES = [
  // Direction, brightness, and corners of each face, in order around it.
  [[0, 1, 0], 1.0, [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]]],
  [[0, -1, 0], 0.5, [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]],
  [[0, 0, 1], 0.82, [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]],
  [[0, 0, -1], 0.7, [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]]],
  [[1, 0, 0], 0.9, [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]]],
  [[-1, 0, 0], 0.62, [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]]],
];
const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
const GREY = [150, 155, 162];
const RED = [222, 48, 44], PURPLE = [191, 38, 191], ORANGE = [230, 64, 26];
const GROUND = [[122, 168, 92], [114, 158, 86]];
const WHOLE = [0, 0, 0, 16, 16, 16], SMALL = [5, 5, 5, 11, 11, 11];
const MARGIN = 2, GROUND_SPAN = 128;
// One turn takes less than the five seconds after which movement needs a button to stop it (WCAG 2.2.2).
const TURN_MS = 4900;
const AXES = [["x", [1, 0, 0], [226, 72, 62]], ["y", [0, 1, 0], [88, 178, 80]], ["z", [0, 0, 1], [72, 120, 226]]];
const counted = (n, noun) => `${n} ${noun}${n === 1 ? "" : "s"}`;
const isCalm = matchMedia("(prefers-reduced-motion: reduce)");
const cameras = new Map();

const VERTEX = `#version 300 es
uniform mat4 view; in vec3 place; in vec4 paint; out vec3 colour; out vec2 corner;
const vec2 CORNERS[4] = vec2[4](vec2(0, 0), vec2(0, 1), vec2(1, 1), vec2(1, 0));
void main() { gl_Position = view * vec4(place, 1); colour = paint.rgb; corner = CORNERS[gl_VertexID & 3]; }`;
const FRAGMENT = `#version 300 es
precision mediump float; uniform float edges; in vec3 colour; in vec2 corner; out vec4 shown;
void main() { vec2 near = min(corner, 1.0 - corner); float edge = min(near.x, near.y);
  shown = vec4(colour * (1.0 - edges * 0.25 * (1.0 - smoothstep(0.0, 0.05, edge))), 1); }`;

const key = (x, y, z) => ((x + 1048576) * 2097152 + (z + 1048576)) * 1024 + (y + 512);
const ramp = (share) => {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1), i = Math.min(Math.floor(at), RAMP.length - 2);
  return RAMP[i].map((low, c) => low + (RAMP[i + 1][c] - low) * (at - i));
};
/* Returns whether a box reaches the given side of its cell. */
const touches = (box, side) => (side % 2 ? box[[1, 2, 0][side >> 1]] === 0 : box[[4, 5, 3][side >> 1]] === 16);
const pascal = (pa) => (pa >= 1e6 ? `${(pa / 1e6).toPrecision(3)} MPa` : pa >= 1e3 ? `${(pa / 1e3).toPrecision(3)} kPa` : `${pa.toPrecision(3)} Pa`);

/* Returns cells without those that occur twice. */
const distinct = (cells) => [...new Map(cells.map((cell) => [key(...cell), cell])).values()];

function program(gl) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.bindAttribLocation(made, 0, "place");
  gl.bindAttribLocation(made, 1, "paint");
  gl.linkProgram(made);
  return gl.getProgramParameter(made, gl.LINK_STATUS) ? made : null;
}

/* Returns whether WebGL renders in software: antialiasing and high pixel density then cost more than they show. */
function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

/* Returns the product of the perspective and view matrices in column-major order; the camera looks at the centre. */
function matrix({ yaw, pitch, distance, centre }, aspect) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  const right = [cy, 0, -sy], up = [-sy * sp, cp, -cy * sp], back = [sy * cp, sp, cy * cp];
  const eye = centre.map((c, i) => c + back[i] * distance);
  const dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
  const f = 1.7, near = distance / 100, far = distance * 10;
  const [a, b] = [(far + near) / (near - far), (2 * far * near) / (near - far)];
  const columns = [];
  for (let i = 0; i < 3; i++) columns.push((f / aspect) * right[i], f * up[i], a * back[i], -back[i]);
  columns.push((f / aspect) * dot(right), f * dot(up), a * dot(back) + b, -dot(back));
  return new Float32Array(columns);
}

/* Returns the edges of what stands at the end of a log, as pairs of ends, moved so that its lowest layer is centred on
   `centre`. Edges inside a plane side are left out. */
function outline(log, centre) {
  const blocks = new Map();
  for (const [x, y, z, material] of log.turns.flat()) {
    if (material === undefined) blocks.delete(key(x, y, z));
    else blocks.set(key(x, y, z), [x, y, z]);
  }
  const cells = [...blocks.values()], ends = [0, 1, 2].map((i) => [Math.min(...cells.map((c) => c[i])), Math.max(...cells.map((c) => c[i])) + 1]);
  const move = ends.map(([low, high], i) => (i === 1 ? centre[1] - low : Math.round(centre[i] - (low + high) / 2)));
  const edges = new Map();
  for (const cell of cells) SIDES.forEach(([way, , corners], side) => {
    if (blocks.has(key(...cell.map((c, i) => c + way[i])))) return;
    corners.forEach((corner, i) => {
      const pair = [corner, corners[(i + 1) % 4]].map((at) => at.map((c, j) => c + cell[j] + move[j])).sort((a, b) => a[0] - b[0] || a[1] - b[1] || a[2] - b[2]);
      const name = `${side} ${pair}`;
      edges.has(name) ? edges.delete(name) : edges.set(name, pair);
    });
  });
  return [...edges.values()];
}

class Viewer {
  constructor(root, scene, log) {
    this.root = root;
    this.scene = scene;
    this.canvas = root.querySelector("canvas");
    this.isSoft = drawsInSoftware();
    this.gl = this.canvas.getContext("webgl2", { antialias: !this.isSoft });
    this.palette = log.palette;
    // Colours of top and sides, and boxes in sixteenths of a block where it does not fill its cell.
    this.looks = log.palette.map((name) => scene.looks[name] ?? [GREY, GREY]);
    this.events = log.turns.flat();
    let end = 0;
    this.turnEnds = log.turns.map((turn) => (end += turn.length));
    this.hidden = new Set();
    this.mode = "material";
    this.stress = new Map();
    this.at = this.events.length;
  }

  start() {
    const gl = this.gl;
    this.program = gl && program(gl);
    if (!this.program) return false;
    gl.useProgram(this.program);
    gl.enable(gl.DEPTH_TEST);
    this.mesh = gl.createBuffer();
    this.paints = gl.createBuffer();
    this.order = gl.createBuffer();
    this.path = gl.createBuffer();
    this.lines = gl.createBuffer();
    this.ghostLines = gl.createBuffer();
    this.ghostEnds = 0;
    this.bounds();
    const shared = this.root.dataset.camera;
    this.camera = (shared && cameras.get(shared)) || { yaw: 0.7, pitch: 0.55, distance: this.size * 1.1 + 5, views: [] };
    if (shared) cameras.set(shared, this.camera);
    this.camera.distance = Math.max(this.camera.distance, this.size * 1.1 + 5);
    this.camera.views.push(this);
    this.camera.home = { yaw: 0.7, pitch: 0.55, distance: this.camera.distance };
    this.root.classList.add("live");
    this.controls();
    this.steer();
    this.recall();
    this.rebuild();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    if (this.root.closest("[data-turning]")) this.spin();
    return true;
  }

  bounds() {
    let low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const event of this.events) for (let i = 0; i < 3; i++) {
      low[i] = Math.min(low[i], event[i]);
      high[i] = Math.max(high[i], event[i] + 1);
    }
    if (!this.events.length) [low.fill(0), high.fill(1)];
    // Coordinates are relative to the lowest corner from here on: 32-bit floats lose precision far from the origin.
    const [ox, oy, oz] = low;
    const near = ([x, y, z, ...rest]) => [x - ox, y - oy, z - oz, ...rest];
    this.near = near;
    this.events = this.events.map(near);
    this.witnesses = this.failed = distinct((this.scene.witnesses ?? []).map(near));
    this.isCut = Boolean(this.scene.is_cut);
    this.origin = [ox, oy, oz];
    [this.low, this.high] = [[0, 0, 0], near(high)];
    [low, high] = [this.low, this.high];
    // The view reaches up to the surface of the ground, also where everything lies below it.
    this.buried = Math.max(-oy - high[1], 0);
    const ends = [high[0], this.buried <= GROUND_SPAN ? Math.max(high[1], -oy) : high[1], high[2]];
    this.centre = low.map((l, i) => (l + ends[i]) / 2);
    this.size = Math.hypot(...low.map((l, i) => ends[i] - l));
  }

  /* Returns the blocks after the first `at` events. Placing on a block keeps its position in the order; removing from
     an empty cell does nothing. */
  standing() {
    const blocks = new Map();
    for (let i = 0; i < this.at; i++) {
      const [x, y, z, material] = this.events[i];
      if (material === undefined) blocks.delete(key(x, y, z));
      else blocks.set(key(x, y, z), [x, y, z, material]);
    }
    return blocks;
  }

  paint(block, witnesses) {
    if (this.mode === "witness") return witnesses.has(key(...block)) ? RED : GREY;
    if (this.mode === "material") return null;
    const field = this.stress.get(this.mode);
    const value = field?.at.get(key(...block));
    return value === undefined || value === null ? GREY : ramp(field.max > 0 ? value / field.max : 0);
  }

  rebuild() {
    const blocks = this.standing(), slice = Number(this.slice.value);
    const shows = (b) => b && b[1] <= slice && !this.hidden.has(b[3]);
    const cells = this.witnesses;
    const witnesses = new Set(cells.map((cell) => key(...cell)));
    const places = [], paints = [];
    let shown = 0;
    // A side of a box in sixteenths of a block: the least corner and the greatest.
    const face = ([x, y, z], [ax, ay, az, bx, by, bz], side, colour) => {
      const [, light, corners] = SIDES[side];
      for (const [cx, cy, cz] of corners) {
        places.push(x + (cx ? bx : ax) / 16, y + (cy ? by : ay) / 16, z + (cz ? bz : az) / 16);
        paints.push(colour[0] * light, colour[1] * light, colour[2] * light, 255);
      }
    };
    const fills = (b) => shows(b) && !this.looks[b[3]][2];
    for (const block of blocks.values()) {
      if (!shows(block)) continue;
      shown++;
      const [x, y, z, material] = block, [top, sides, boxes] = this.looks[material];
      const colour = this.paint(block, witnesses);
      for (let side = 0; side < 6; side++) {
        const [dx, dy, dz] = SIDES[side][0], isCovered = fills(blocks.get(key(x + dx, y + dy, z + dz)));
        for (const box of boxes ?? [WHOLE]) {
          if (isCovered && touches(box, side)) continue;
          face(block, box, side, colour ?? (side === 0 ? top : sides));
        }
      }
    }
    // Witness cells without a block, such as leaking air or a missing corner.
    if (this.mode === "witness") for (const [x, y, z] of cells) if (y <= slice && !blocks.has(key(x, y, z))) for (let side = 0; side < 6; side++) face([x, y, z], SMALL, side, RED);
    const faces = places.length / 12;
    if (this.ground.checked) for (const cell of this.groundAround()) face(cell, WHOLE, 0, GROUND[(cell[0] + cell[2] + cell[3]) & 1]);
    const drawn = places.length / 12, order = new Uint32Array(drawn * 6);
    for (let i = 0; i < drawn; i++) order.set([4 * i, 4 * i + 1, 4 * i + 2, 4 * i, 4 * i + 2, 4 * i + 3], 6 * i);
    const gl = this.gl, fill = (buffer, kind, data) => { gl.bindBuffer(kind, buffer); gl.bufferData(kind, data, gl.DYNAMIC_DRAW); };
    fill(this.mesh, gl.ARRAY_BUFFER, new Float32Array(places));
    fill(this.paints, gl.ARRAY_BUFFER, new Uint8Array(paints));
    fill(this.order, gl.ELEMENT_ARRAY_BUFFER, order);
    const way = [];
    if (this.walk.checked) for (let i = 0; i < this.at; i++) if (this.events[i].length > 3) way.push(...this.events[i].slice(0, 3).map((c) => c + 0.5));
    fill(this.path, gl.ARRAY_BUFFER, new Float32Array(way));
    fill(this.lines, gl.ARRAY_BUFFER, new Float32Array(this.axes().flatMap(([from, to]) => [...from, ...to])));
    [this.faces, this.steps] = [drawn, way.length / 3];
    Object.assign(this.canvas.dataset, { blocks: shown, faces, mode: this.mode, step: this.at });
    const top = slice + this.origin[1], isCut = slice < Number(this.slice.max);
    this.slice.setAttribute("aria-valuetext", `y = ${top}`);
    this.height.textContent = `y = ${top}${isCut ? `: ${shown} of ${counted(blocks.size, "block")}` : ""}`;
    this.told.textContent = `${this.at} of ${counted(this.events.length, "event")}, ${counted(blocks.size, "block")}${this.buried ? `; the top lies ${counted(this.buried, "block")} deep in the ground` : ""}`;
    // Whoever listens hears where the view rests, not each step on the way.
    clearTimeout(this.telling);
    if (!this.playing) this.telling = setTimeout(() => (this.status.textContent = this.told.textContent), 700);
    this.draw();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      const gl = this.gl, scale = this.isSoft ? 1 : Math.min(devicePixelRatio || 1, 2);
      const [width, height] = [this.canvas.clientWidth * scale, this.canvas.clientHeight * scale].map(Math.round);
      if (!width || !height) return;
      if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
      gl.viewport(0, 0, width, height);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const view = matrix({ ...this.camera, centre: this.centre }, width / height);
      gl.uniformMatrix4fv(gl.getUniformLocation(this.program, "view"), false, view);
      const edges = gl.getUniformLocation(this.program, "edges");
      gl.uniform1f(edges, 1);
      gl.enableVertexAttribArray(0);
      gl.enableVertexAttribArray(1);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.mesh);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.paints);
      gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 0, 0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.order);
      gl.drawElements(gl.TRIANGLES, this.faces * 6, gl.UNSIGNED_INT, 0);
      this.label(view);
      gl.uniform1f(edges, 0);
      gl.disableVertexAttribArray(1);
      const lines = (ends, kind, from, count, colour) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, ends);
        gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
        gl.vertexAttrib4f(1, ...colour.map((c) => c / 255), 1);
        gl.drawArrays(kind, from, count);
      };
      if (this.ground.checked) AXES.forEach(([, , colour], i) => lines(this.lines, gl.LINES, 2 * i, 2, colour));
      if (this.ghost?.checked && this.ghostEnds) lines(this.ghostLines, gl.LINES, 0, this.ghostEnds, PURPLE);
      if (this.steps > 1) {
        gl.disable(gl.DEPTH_TEST);
        lines(this.path, gl.LINE_STRIP, 0, this.steps, ORANGE);
        gl.enable(gl.DEPTH_TEST);
      }
    });
  }

  controls() {
    const find = (name) => this.root.querySelector(`[data-control=${name}]`);
    [this.slice, this.height, this.time, this.walk, this.ground, this.told, this.status, this.legend] = ["slice", "height", "time", "walk", "ground", "told", "status", "legend"].map(find);
    this.coloured = find("colour");
    Object.assign(this.slice, { min: this.low[1], max: this.high[1] - 1, value: this.high[1] - 1 });
    Object.assign(this.time, { min: 0, max: this.events.length, value: this.at });
    this.ghost = find("ghost");
    for (const control of [this.slice, this.walk, this.ground]) control.addEventListener("input", () => { this.rebuild(); this.remember(); });
    this.ghost?.addEventListener("input", () => { this.showReference(); this.remember(); });
    this.names = AXES.map(([name]) => {
      const label = Object.assign(document.createElement("span"), { className: `axis ${name}`, ariaHidden: "true" });
      this.canvas.after(label);
      return label;
    });
    for (const check of this.root.closest("[data-shown]")?.querySelectorAll("details.check") ?? []) check.addEventListener("toggle", () => this.flag(check));
    this.time.addEventListener("input", () => this.go(Number(this.time.value)));
    this.coloured.addEventListener("change", () => this.colour(this.coloured.value));
    const play = find("play");
    play.addEventListener("click", () => this.play(play));
    find("back").addEventListener("click", () => this.go(this.at - 1));
    find("on").addEventListener("click", () => this.go(this.at + 1));
    const list = find("materials"), used = new Set(this.events.map((event) => event[3]));
    this.palette.forEach((name, i) => {
      if (!used.has(i)) return;
      const [label, box, swatch] = ["label", "input", "canvas"].map((tag) => document.createElement(tag));
      Object.assign(label, { className: "check" });
      Object.assign(box, { type: "checkbox", checked: true });
      Object.assign(swatch, { className: "swatch", width: 1, height: 1 });
      const brush = swatch.getContext("2d");
      brush.fillStyle = `rgb(${this.looks[i][1].join()})`;
      brush.fillRect(0, 0, 1, 1);
      box.dataset.material = i;
      box.addEventListener("input", () => { box.checked ? this.hidden.delete(i) : this.hidden.add(i); this.rebuild(); this.remember(); });
      label.append(box, swatch, name);
      list.append(label);
    });
  }

  /* Shows the blocks that an opened check flags, as they stand at the end of its turn; all that failed once none is open. */
  flag(check) {
    const open = this.root.closest("[data-shown]").querySelector("details.check[open]");
    if (check.open) {
      this.witnesses = distinct(JSON.parse(check.dataset.cells).map(this.near));
      this.flagged = Number(check.dataset.total);
      this.go(this.turnEnds[check.dataset.turn - 1] ?? this.events.length);
    } else if (!open) {
      this.witnesses = this.failed;
      this.flagged = undefined;
    } else return;
    const mode = check.open && this.witnesses.length ? "witness" : "material";
    // A check without flagged blocks leaves the colours as they are.
    if (mode === "witness" || (!check.open && this.mode === "witness")) this.colour(mode);
  }

  /* Says how many cells are red: a report names some of many only. */
  flags() {
    const shown = this.witnesses.length, all = this.flagged ?? shown;
    if (all > shown) return `${shown} of ${counted(all, "flagged block")}, in red`;
    const cut = this.flagged === undefined && this.isCut ? "; a check that flags many marks some of them" : "";
    return `${counted(shown, "flagged block")}, in red${cut}`;
  }

  /* Draws the edges of the reference build where the agent built, to compare the two. */
  async showReference() {
    const told = this.root.querySelector("[data-control=ghost-told]");
    if (this.ghost.checked && !this.ghostEnds) {
      const answer = await fetch(this.scene.reference).catch(() => null);
      if (!answer?.ok) {
        told.textContent = "The reference build could not be loaded.";
        this.ghost.checked = false;
        return;
      }
      const base = [this.centre[0], Math.max(0, -this.origin[1]), this.centre[2]];
      const ends = outline(await answer.json(), base).flat(2), gl = this.gl;
      gl.bindBuffer(gl.ARRAY_BUFFER, this.ghostLines);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(ends), gl.STATIC_DRAW);
      this.ghostEnds = ends.length / 3;
    }
    this.canvas.dataset.ghost = this.ghost.checked ? this.ghostEnds : 0;
    told.textContent = this.ghost.checked ? "Purple lines: a reference build, moved to where this one stands" : "";
    this.draw();
  }

  /* Returns the cells of the flat world's ground around the build, without those that the build touches. */
  groundAround() {
    const [ox, oy, oz] = this.origin, [w, , d] = this.high;
    if (Math.max(w, d) > GROUND_SPAN || -oy - 1 > this.high[1] + GROUND_SPAN) return [];
    const touched = new Set(this.events.filter(([, y]) => y + oy < 0).map(([x, , z]) => `${x},${z}`));
    const cells = [], even = (ox + oz) & 1;
    for (let x = -MARGIN; x < w + MARGIN; x++) for (let z = -MARGIN; z < d + MARGIN; z++) if (!touched.has(`${x},${z}`)) cells.push([x, -oy - 1, z, even]);
    return cells;
  }

  /* Returns the ends of the axes: from the corner of the ground, as long as the build. */
  axes() {
    const from = [-MARGIN, Math.max(-this.origin[1], 0), -MARGIN];
    return AXES.map(([, way], i) => [from, from.map((at, j) => at + way[j] * (this.high[i] + (i === 1 ? 1 : MARGIN)))]);
  }

  /* Writes the names of the axes, with the extent of the build, where they end on the screen. */
  label(view) {
    this.axes().forEach(([, to], i) => {
      const [x, y, , w] = [0, 1, 2, 3].map((row) => view[row] * to[0] + view[4 + row] * to[1] + view[8 + row] * to[2] + view[12 + row]);
      const label = this.names[i], size = this.high[i];
      label.hidden = !this.ground.checked || w <= 0 || Math.abs(x) > w || Math.abs(y) > w;
      label.textContent = `${AXES[i][0]} ${size}`;
      Object.assign(label.style, { left: `${50 + (x / w) * 50}%`, top: `${50 - (y / w) * 50}%` });
    });
  }

  go(step) {
    this.at = Math.min(Math.max(step, 0), this.events.length);
    this.time.value = this.at;
    this.rebuild();
    this.remember();
  }

  play(button) {
    if (this.playing) {
      clearInterval(this.playing);
      this.playing = 0;
      button.textContent = "Play";
      return;
    }
    button.textContent = "Pause";
    if (this.at >= this.events.length) this.go(0);
    // In ten steps for those who want little motion.
    const [steps, pause] = isCalm.matches ? [10, 1000] : [240, 33];
    const stride = Math.max(1, Math.ceil(this.events.length / steps));
    this.playing = setInterval(() => (this.at < this.events.length ? this.go(this.at + stride) : this.play(button)), pause);
  }

  async colour(mode) {
    if (mode in (this.scene.stress ?? {}) && !this.stress.has(mode)) {
      this.legend.textContent = "Computing…";
      const given = this.scene.stress[mode];
      const answer = typeof given === "string" ? await fetch(given).then(async (r) => [r.ok, await r.json()]) : [true, given];
      if (!answer[0]) {
        this.legend.textContent = answer[1].detail;
        return;
      }
      const field = answer[1], at = new Map();
      field.cells.forEach((cell, i) => at.set(key(...this.near(cell)), field.von_mises_pa[i]));
      this.stress.set(mode, { at, max: field.von_mises_pa.reduce((most, pa) => Math.max(most, pa ?? 0), 0) });
    }
    this.mode = mode;
    this.coloured.value = mode;
    this.legend.replaceChildren();
    const field = this.stress.get(mode);
    if (field) {
      const strip = Object.assign(document.createElement("canvas"), { width: 100, height: 1 }), brush = strip.getContext("2d");
      for (let i = 0; i < 100; i++) {
        brush.fillStyle = `rgb(${ramp(i / 99).map(Math.round).join()})`;
        brush.fillRect(i, 0, 1, 1);
      }
      this.legend.append(strip, `von Mises stress, 0 to ${pascal(field.max)}`);
    } else if (mode === "witness") this.legend.textContent = this.flags();
    this.rebuild();
    this.remember();
  }

  /* Turns the view once around, until somebody takes hold of it; not for those who want little motion. */
  spin() {
    if (isCalm.matches || this.camera.isTurning) return;
    this.camera.isTurning = true;
    const begun = performance.now(), from = this.camera.yaw;
    const step = (now) => {
      const share = Math.min((now - begun) / TURN_MS, 1);
      if (!this.camera.isTurning) return;
      this.camera.yaw = from + 2 * Math.PI * share;
      this.camera.views.forEach((view) => view.draw());
      if (share < 1) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /* Stores camera, step and colouring in the URL, so that the view can be shared. */
  remember() {
    if (this.root.dataset.camera || this.playing) return;
    // Waits until the view rests: browsers limit the rate of history changes.
    clearTimeout(this.remembering);
    this.remembering = setTimeout(() => {
      const { yaw, pitch, distance } = this.camera;
      const shown = [this.ground.checked ? "g" : "", this.walk.checked ? "w" : "", this.ghost?.checked ? "r" : ""].join("");
      const view = [...[yaw, pitch, distance].map((n) => n.toFixed(2)), this.at, this.mode, this.slice.value, shown, [...this.hidden].join("-")];
      history.replaceState(null, "", `#${view.join(",")}`);
    }, 150);
  }

  recall() {
    const told = location.hash.slice(1).split(",");
    // Addresses of before have neither height nor what is shown.
    if (this.root.dataset.camera || (told.length !== 5 && told.length !== 8)) return;
    const [yaw, pitch, distance, at] = told.slice(0, 4).map(Number);
    if (told.length === 8) {
      if (Number.isFinite(Number(told[5]))) this.slice.value = told[5];
      this.ground.checked = told[6].includes("g");
      this.walk.checked = told[6].includes("w");
      if (this.ghost && told[6].includes("r")) {
        this.ghost.checked = true;
        this.showReference();
      }
      for (const i of told[7].split("-").filter(Boolean)) this.root.querySelector(`[data-material="${Number(i)}"]`)?.click();
      this.rebuild();
    }
    if ([yaw, pitch, distance, at].every(Number.isFinite)) {
      Object.assign(this.camera, { yaw, pitch, distance });
      this.at = Math.min(Math.max(at, 0), this.events.length);
      this.time.value = this.at;
    }
    if ([...this.coloured.options].some((option) => option.value === told[4])) this.colour(told[4]);
  }

  turn(yaw, pitch, zoom) {
    const camera = this.camera;
    camera.isTurning = false;
    camera.yaw += yaw;
    camera.pitch = Math.min(Math.max(camera.pitch + pitch, -1.55), 1.55);
    camera.distance = Math.min(Math.max(camera.distance * zoom, 2), 5000);
    camera.views.forEach((view) => view.draw());
    this.remember();
  }

  steer() {
    const pointers = new Map(), canvas = this.canvas;
    const spread = () => { const [a, b] = [...pointers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); pointers.set(e.pointerId, [e.clientX, e.clientY]); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => pointers.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => {
      const before = pointers.get(e.pointerId);
      if (!before) return;
      const apart = pointers.size === 2 ? spread() : 0;
      pointers.set(e.pointerId, [e.clientX, e.clientY]);
      if (pointers.size === 2) this.turn(0, 0, apart / Math.max(spread(), 1));
      else this.turn((before[0] - e.clientX) / 150, (e.clientY - before[1]) / 150, 1);
    });
    // The wheel scrolls the page until the view has the focus.
    canvas.addEventListener("wheel", (e) => {
      if (document.activeElement !== canvas) return;
      e.preventDefault();
      this.turn(0, 0, Math.exp(e.deltaY / 800));
    }, { passive: false });
    const keys = { ArrowLeft: [0.1, 0, 1], ArrowRight: [-0.1, 0, 1], ArrowUp: [0, 0.1, 1], ArrowDown: [0, -0.1, 1], "+": [0, 0, 0.9], "=": [0, 0, 0.9], "-": [0, 0, 1.1] };
    canvas.addEventListener("keydown", (e) => {
      if (keys[e.key]) this.turn(...keys[e.key]);
      else if (e.key === "," || e.key === ".") this.go(this.at + (e.key === "." ? 1 : -1));
      else if (e.key === "Home") { Object.assign(this.camera, this.camera.home); this.turn(0, 0, 1); }
      else return;
      e.preventDefault();
    });
  }
}

for (const root of document.querySelectorAll(".viewer")) {
  const scene = JSON.parse(root.querySelector("script.scene").textContent);
  const log = typeof scene.log === "string" ? await fetch(scene.log).then((answer) => answer.json()) : scene.log;
  if (!new Viewer(root, scene, log).start()) root.classList.add("still");
}
