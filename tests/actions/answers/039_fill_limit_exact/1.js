bot.chat('/fill -16 0 -16 15 31 15 snow_block')
