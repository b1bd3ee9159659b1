import * as skills from '../../../src/agent/library/skills.js';
import * as mc from '../../../src/utils/mcdata.js';

export async function main(bot) {
    let i = 0;
    for (const color of mc.WOOL_COLORS) {
        if (mc.getBlockId(`${color}_wool`)) {
            await skills.placeBlock(bot, `${color}_wool`, i, 0, -3);
            i++;
        }
    }
}
