"""Paints burns, and what may be taken for one, on details of intact rope (src/vision/detail.rs).

Simulated ropes have some hundred burns between them; burns by chance on rope of several cameras make as many as one likes. Gray in a
detail is told in bins, 32 g/(g + light): g over light follows, so what is painted darkens and brightens as paint on the rope would.
"""

import jax
import jax.numpy as jnp

SIDE = 64
NOTHING, BURN, DROP, DARK, BRIGHT, SPECKS = range(6)
AT = jnp.arange(SIDE) - (SIDE - 1) / 2


def roughness(key, count, cells):
    """Smooth fields of chance with so many cells a side."""
    return jax.image.resize(jax.random.normal(key, (count, cells, cells)), (count, SIDE, SIDE), "cubic")


def not_zero_near(layer):
    """Where a value or one beside it is known; 0 stands for what is not, and now and then for a 0."""
    return jax.lax.reduce_window((layer != 0).astype(jnp.float32), 0.0, jax.lax.max, (1, 3, 3), (1, 1, 1), "SAME") > 0


def paint(key, details, what):
    """Details `[n, row, column, (gray/16 - 1, deviation/4 bins)]` with what is asked for on each."""
    n, keys = len(details), iter(jax.random.split(key, 64))
    chance = lambda low, high: jax.random.uniform(next(keys), (n, 1, 1), minval=low, maxval=high)
    log_chance = lambda low, high: jnp.exp(chance(jnp.log(low), jnp.log(high)))
    angle = lambda: chance(0, 2 * jnp.pi)
    edge = lambda r, width: jax.nn.sigmoid((1 - r) / width * 2)
    gray, (seen, known) = (details[..., 0] + 1) * 16, map(not_zero_near, (details[..., 0], details[..., 1]))
    light = gray / jnp.maximum(32 - gray, 0.5)

    # A spot somewhere about the middle: its radius, and how far every place is from its own middle in radii.
    radius = log_chance(4.0, 30.0)
    middle_x, middle_y = chance(-1, 1) * jnp.minimum(8, radius * 0.8), chance(-1, 1) * jnp.minimum(10, radius * 0.9)
    x, y = AT[None, None, :] - middle_x, AT[None, :, None] - middle_y
    turn, longer = chance(0, jnp.pi), jnp.exp(0.25 * jax.random.normal(next(keys), (n, 1, 1)))
    along, across = x * jnp.cos(turn) + y * jnp.sin(turn), -x * jnp.sin(turn) + y * jnp.cos(turn)
    coarse, medium, fine, grain = (roughness(next(keys), n, cells) for cells in (7, 13, 22, 40))
    away = jnp.sqrt((along * jnp.sqrt(longer)) ** 2 + (across / jnp.sqrt(longer)) ** 2) / radius
    ragged = jnp.select(
        [what[:, None, None] == BURN, what[:, None, None] == DROP],
        [chance(0, 0.16) * chance(0, 1.6), chance(0, 0.05)],
        chance(0.05, 0.35),
    )
    r = away + ragged * (jnp.where(radius < 12, medium, coarse) + 0.4 * fine)
    direction = jnp.arctan2(y, x)
    dot = lambda px, py, sx, sy: jnp.exp(-((AT[None, None, :] - px) ** 2) / (2 * sx**2) - (AT[None, :, None] - py) ** 2 / (2 * sy**2))

    # Burn: a crater, a rim that is brighter towards the lamp, and a tarnished halo.
    crater, halo_to = edge(r, chance(0.03, 0.22)), chance(1.3, 2.3)
    rim = jnp.exp(-(((r - chance(0.85, 1.25)) / chance(0.08, 0.35)) ** 2)) * (1 + chance(0, 0.9) * jnp.cos(direction - angle()))
    halo = jnp.clip((halo_to - r) / (halo_to - 1), 0, 1)
    burn = (1 - halo * chance(-0.05, 0.4)) * (1 - crater * chance(0.15, 0.8)) * (1 + 0.6 * crater * chance(0, 0.35) * grain)
    burn = light * burn + rim * log_chance(0.12, 1.1) * (0.75 * light + 0.25 * jnp.clip(light, 0, 1.5))

    # Drop: a lens that turns what is behind it over, with a dark outline and one or two bright dots.
    inside, turned = edge(r, chance(0.02, 0.08)), chance(0, 0.9)
    outline = jnp.exp(-(((r - chance(0.9, 1.02)) / chance(0.04, 0.15)) ** 2)) * chance(-0.12, 0.45)
    size = radius * chance(0.08, 0.3) + 0.8
    dots = [
        dot(middle_x + radius * chance(-f, f), middle_y + radius * chance(-f, f), size * s, size * s * chance(0.7, 1.4)) * chance(low, high)
        for f, s, low, high in ((0.6, 1.0, 0.4, 3.2), (0.8, chance(0.5, 1.5), 0.0, 1.0))
    ]
    lens = light + inside * turned * (light[:, ::-1, ::-1] - light)
    tilt = chance(0, 0.35) * (x * jnp.cos(angle()) + y * jnp.sin(angle())) / radius
    drop = lens * (1 - inside * (1 - chance(0.5, 1.08) * (1 + tilt))) * (1 - outline) + inside * sum(dots)

    # Tar and grease, now and then with a gleam; lime and paint; specks of dirt.
    blob = edge(r, chance(0.03, 0.4))
    gleam = dot(middle_x + radius * chance(-0.5, 0.5), middle_y + radius * chance(-0.5, 0.5), radius * chance(0.05, 0.2) + 0.7, radius * chance(0.1, 0.5) + 1)
    dark = light * (1 - blob * chance(0.25, 0.92) * (1 + 0.15 * fine)) + blob * gleam * chance(0, 1) * (chance(0, 1) > 0.6)
    bright = light * (1 + blob * chance(0.15, 1.2) * (1 + 0.3 * fine))
    speck = jax.nn.sigmoid((0.7 * grain + 0.5 * fine - chance(1.2, 1.9)) * 6) * jax.nn.sigmoid((1.6 - away) / 0.2)
    specks = light * (1 - speck * chance(0.2, 0.8))

    painted = jnp.select([what[:, None, None] == k for k in (BURN, DROP, DARK, BRIGHT, SPECKS)], [burn, drop, dark, bright, specks], light)
    painted = jnp.maximum(painted, 0.03 * light)
    change, blur = 32 * painted / (1 + painted) - gray, chance(0, 0.25)  # the lens blurs it
    for axis in (1, 2):
        change = change * (1 - 2 * blur) + blur * (jnp.roll(change, 1, axis) + jnp.roll(change, -1, axis))
    change = change * (what != NOTHING)[:, None, None]
    return jnp.stack([details[..., 0] + seen * change / 16, details[..., 1] + known * change / 4], -1)
