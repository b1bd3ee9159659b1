// Sends the commands of builds.json through a mineflayer bot to a real server, flying-squid, and writes what then stands
// there into blocks.json. README.md says how to run it. Nothing else listens or is called: the server is at 127.0.0.1.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";

const require = createRequire(import.meta.url);
const [squid, mineflayer, { Vec3 }] = [require("flying-squid"), require("mineflayer"), require("vec3")];
const version = "1.21.4";
// The server's uppermost layer of ground is at y = 4; ours is at y = -1.
const UP = 5;
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const event = (of, name) => new Promise((done) => of.once(name, done));

async function replay({ name, box, calls }) {
  const server = squid.createMCServer({
    host: "127.0.0.1", port: 0, version, motd: name, "online-mode": false, "max-players": 1, "max-entities": 10, logging: false, gameMode: 1,
    difficulty: 0, generation: { name: "superflat", options: { seed: 1 } }, kickTimeout: 30000, plugins: {}, modpe: false, "view-distance": 3,
    "everybody-op": true, "player-list-text": { header: { text: "" }, footer: { text: "" } },
  });
  await event(server, "ready");
  const { port } = server._server.socketServer.address();
  const bot = mineflayer.createBot({ host: "127.0.0.1", port, username: "builder", auth: "offline", version, viewDistance: 3 });
  await event(bot, "spawn");
  bot.physics.gravity = 0;
  await bot.waitForChunksToLoad();
  // The server ends the login at the first look, and then puts the bot back to where it began.
  await bot.look(1, 0, true);
  await pause(1500);
  const moveTo = async (to) => {
    for (let agreed = 0; agreed < 6; ) {
      bot.entity.velocity.set(0, 0, 0);
      bot.entity.position.set(to.x, to.y, to.z);
      await pause(50);
      agreed = server.players[0].position.distanceTo(to) < 0.01 ? agreed + 1 : 0;
    }
  };
  await moveTo(new Vec3(0.5, 12, 0.5));
  for (const call of calls) {
    if (call.kind === "move") {
      await moveTo(new Vec3(call.x, call.y + UP, call.z));
      continue;
    }
    const [command, x, y, z, ...rest] = call.text.split(" ");
    bot.chat([command, x, y.startsWith("~") ? y : Number(y) + UP, z, ...rest].join(" "));
  }
  await pause(2000);
  const [x1, y1, z1, x2, y2, z2] = box;
  const blocks = [];
  for (let y = y1; y <= y2; y++)
    for (let x = x1; x <= x2; x++)
      for (let z = z1; z <= z2; z++) {
        const block = bot.blockAt(new Vec3(x, y + UP, z));
        if (block.name !== "air") blocks.push([x, y, z, block.name]);
      }
  bot.quit();
  await server.quit("done");
  return { name, blocks };
}

const builds = JSON.parse(readFileSync(new URL("builds.json", import.meta.url)));
const done = [];
for (const build of builds) done.push(await replay(build));
writeFileSync(new URL("blocks.json", import.meta.url), `[\n${done.map((build) => JSON.stringify(build)).join(",\n")}\n]\n`);
process.exit(0);
