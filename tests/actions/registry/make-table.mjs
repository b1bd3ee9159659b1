// Writes table.json from the npm packages minecraft-data and prismarine-block; see README.md. Run with Node.
import { writeFileSync } from "node:fs";
import data from "minecraft-data";
import loader from "prismarine-block";

const game = data("1.21.4");
const Block = loader("1.21.4");
const blocks = game.blocksArray.map((block) => {
  // The default state and the last one.
  const states = [...new Set([block.defaultState, block.maxStateId])].map((id) => {
    const properties = Block.fromStateId(id, 0).getProperties();
    return [id, properties];
  });
  const { id, name, displayName, hardness, stackSize, diggable, transparent, boundingBox, minStateId, maxStateId, defaultState } = block;
  return [[id, name, displayName, hardness ?? -1, stackSize, diggable, transparent, boundingBox, minStateId, maxStateId, defaultState], states];
});
const items = game.itemsArray.map(({ id, name, displayName, stackSize }) => [id, name, displayName, stackSize]);
const rows = (list) => list.map((row) => JSON.stringify(row)).join(",\n");
writeFileSync(new URL("table.json", import.meta.url), `{"blocks":[\n${rows(blocks)}\n],\n"items":[\n${rows(items)}\n]}\n`);
