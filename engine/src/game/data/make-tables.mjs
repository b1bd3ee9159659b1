// Writes blocks.txt and items.txt from the npm package minecraft-data; see README.md. Run with Node.
import { writeFileSync } from "node:fs";
import data from "minecraft-data";

const game = data("1.21.4");

let next = 0;
const lines = game.blocksArray.map((block) => {
  if (block.minStateId !== next) throw new Error(`${block.name} does not begin at state ${next}`);
  next = block.maxStateId + 1;
  let rest = block.defaultState - block.minStateId;
  const properties = [];
  for (const state of [...block.states].reverse()) {
    const values = state.values ?? ["true", "false"];
    const chosen = rest % values.length;
    rest = Math.floor(rest / values.length);
    const shown = values.map((value, at) => (at === chosen ? `*${value}` : value));
    properties.unshift(`${state.name}=${shown.join(",")}`);
  }
  const flags = [
    [block.boundingBox === "block", "solid"],
    [block.diggable, "diggable"],
    [block.transparent, "transparent"],
    [block.drops.length > 0, "item"],
  ];
  const set = flags.filter(([is]) => is).map(([, name]) => name[0]).join("") || "-";
  return [block.name, block.hardness ?? "-", set, ...properties].join(" ");
});
writeFileSync(new URL("blocks.txt", import.meta.url), lines.join("\n") + "\n");

if (!game.itemsArray.every((item, at) => item.id === at)) throw new Error("item numbers have gaps");
writeFileSync(new URL("items.txt", import.meta.url), game.itemsArray.map((item) => item.name).join("\n") + "\n");
