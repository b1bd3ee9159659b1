const { Vec3 } = require('vec3');

module.exports = async function build(bot) {
  const start = new Vec3(0, 0, 0);
  for (let dx = 0; dx < 3; dx++) {
    const p = start.offset(dx, 0, 0);
    await skills.placeBlock(bot, 'mossy_cobblestone', p.x, p.y, p.z);
  }
};
