// Writes table.json: expressions over vectors with the values that the npm package vec3 gives them; see README.md.
import { writeFileSync } from "node:fs";
import vec3 from "vec3";

const { Vec3 } = vec3;
const vectors = ["new Vec3(0, 0, 0)", "new Vec3(1, 2, 3)", "new Vec3(-1.5, 2.25, -0.75)", "new Vec3(10.5, -64, 1e6)", "new Vec3(0.5, 0.5, 0.5)"];
const alone = [
  "isZero()", "at(0)", "at(2)", "at(3)", "xz()", "xy()", "yz()", "xzy()", "set(4, 5, 6)", "rounded()", "round()", "floored()", "floor()",
  "offset(1, -2, 0.5)", "translate(1, -2, 0.5)", "scaled(2.5)", "scale(-2)", "abs()", "volume()", "toString()", "clone()", "norm()", "unit()",
  "normalize()", "toArray()",
];
const paired = [
  "update", "add", "subtract", "multiply", "divide", "plus", "minus", "modulus", "angleTo", "distanceTo", "distanceSquared", "equals", "min",
  "max", "dot", "innerProduct", "cross", "xyDistanceTo", "xzDistanceTo", "yzDistanceTo", "manhattanDistanceTo",
];
const expressions = [
  ...vectors.flatMap((vector) => alone.map((method) => `${vector}.${method}`)),
  ...vectors.flatMap((a) => vectors.flatMap((b) => paired.map((method) => `${a}.${method}(${b})`))),
  "new Vec3(1, 1, 1).equals(new Vec3(1.05, 1, 1), 0.1)", "new Vec3('1', 2, 3)", "new Vec3()", "new Vec3(1, 2, 3).plus({ x: 1, y: 1, z: 1 })",
  "vec3()", "vec3(1, 2, 3)", "vec3('4', '5', '6')", "vec3([7, 8, 9])", "vec3({ x: '1.5', y: 2, z: 3 })", "vec3('(1, -2.5, 3)')", "vec3(null)",
  "vec3.Vec3 === Vec3", "Object.keys(new Vec3(1, 2, 3))", "`${new Vec3(1, 2, 3)}`", "Math.floor(new Vec3(1, 2, 3))",
];
const value = new Function("Vec3", "vec3", `return [${expressions.join(",\n")}].map((value) => JSON.stringify(value));`);
const rows = value(Vec3, vec3).map((result, at) => JSON.stringify([expressions[at], result]));
writeFileSync(new URL("table.json", import.meta.url), `[\n${rows.join(",\n")}\n]\n`);
