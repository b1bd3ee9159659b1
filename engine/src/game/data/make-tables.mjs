// Writes blocks.txt, items.txt and names.txt from the npm package minecraft-data; see README.md. Run with Node.
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

// Titles and stack sizes that do not follow from the name. A block has those of its item, but for lines with a star.
const plain = (name) => name.split("_").map((word) => word[0].toUpperCase() + word.slice(1)).join(" ");
const isOdd = ({ name, displayName, stackSize }) => displayName !== plain(name) || stackSize !== 64;
const line = ({ name, displayName, stackSize }, star) => `${star}${name} ${stackSize} ${displayName}`;
const differs = (block) => {
  const item = game.itemsByName[block.name];
  return item ? item.displayName !== block.displayName || item.stackSize !== block.stackSize : isOdd(block);
};
const odd = [
  ...game.itemsArray.filter(isOdd).map((item) => line(item, "")),
  ...game.blocksArray.filter(differs).map((block) => line(block, "*")),
];
writeFileSync(new URL("names.txt", import.meta.url), odd.join("\n") + "\n");
