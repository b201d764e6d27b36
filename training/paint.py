"""Paints burns and gaps, and what may be taken for one, on details of intact rope (src/vision/detail.rs).

Simulated ropes have some hundred of each between them; what chance paints on rope of several cameras makes as many as one likes. Gray in a
detail is told in bins, 32 g/(g + light): g over light follows, so what is painted darkens and brightens as paint on the rope would.
"""

import math

import torch
import torch.nn.functional as F

SIDE = 48
BURN, DROP, DARK, BRIGHT, SPECKS, FIBRES, GAP = range(7)
AT = torch.arange(SIDE) - (SIDE - 1) / 2


def wire_edges(details):
    """Columns between which the wire in the middle lies, `[n, 1, 1]` each: the valleys on either side, where less gray is expected."""
    known = details[..., 1] != 0
    expected = torch.where(known, details[..., 0] * 16 - details[..., 1] * 4, torch.zeros(()))
    usual = expected.sum(1) / known.sum(1).clamp(min=1)
    usual = F.avg_pool1d(usual[:, None], 5, 1, 2, count_include_pad=False)[:, 0]
    lowest = usual <= -F.max_pool1d(-usual[:, None], 7, 1, 3)[:, 0]
    half = torch.where(lowest, AT.abs(), torch.full((), 99.0))
    of_side = lambda side: torch.where((AT * side > 4) & (AT * side < 22), half, torch.full((), 99.0)).amin(1)
    left, right = of_side(-1), of_side(1)
    either = torch.minimum(left, right)
    either = torch.where(either > 90, 9 + 7 * torch.rand(len(details)), either)
    left, right = (torch.where(half > 90, either, half) for half in (left, right))  # where no valley shows on one side, it is as wide on both
    return -left[:, None, None], right[:, None, None]


def gap(details, light, sides, chance, log_chance, rough):
    """Light of details in which the wire in the middle is broken: torn ends, their faces, and the layer below."""
    n = len(details)
    left, right = wire_edges(details)
    across = (sides[0] - (left + right) / 2) / ((right - left) / 2)  # -1 to 1 on the wire
    on_wire = torch.sigmoid((1 - across.abs()) * (right - left) / 2 / chance(0.3, 0.8))
    half = log_chance(2.0, 20.0)
    y = sides[1] - chance(-1, 1) * torch.clamp(half, max=8)
    # Teeth along an end, some tenths of a millimetre wide: the same in all rows.
    teeth = lambda cells: F.interpolate(torch.randn(n, 1, cells), SIDE, mode="linear", align_corners=False)
    reach = torch.clamp(half, max=9)
    torn = lambda: reach * (chance(-0.5, 0.5) * across + chance(-0.5, 0.5) * (across**2 - 0.4)) + chance(0, 1.8) * (teeth(12) + 0.5 * teeth(24))
    past = [y + half + torn(), half - y + torn()]  # how far a place is in the gap, from either end
    sharp = chance(0.3, 0.7)
    gone = on_wire * torch.sigmoid(past[0] / sharp) * torch.sigmoid(past[1] / sharp)
    wire = (light * on_wire).sum((1, 2), keepdim=True) / SIDE / on_wire.sum(2, keepdim=True)  # its light
    contrast = chance(0, 0.6)
    stripes = 1 - contrast + contrast * torch.sin(log_chance(1.5, 5.0) * across + chance(-0.08, 0.08) * y + chance(0, 2 * math.pi))
    floor = wire * log_chance(0.1, 2.2) * stripes * (1 + 0.15 * rough(13))
    floor = floor * (1 - 0.85 * torch.sigmoid((rough(9) - chance(0.4, 2.5)) * 4))  # old grease
    painted, fine = light, 1 + chance(0, 0.6) * rough(40)
    for beyond in past:
        floor = floor * (1 - chance(0, 0.9) * (chance(0, 1) < 0.4) * torch.exp(-beyond.clamp(min=0) / log_chance(2, 14)))  # in the shadow of an end
        near = torch.exp(-((beyond / log_chance(0.8, 3.0)) ** 2)) * (beyond < 0.5) * on_wire
        painted = painted * (1 + near * chance(-0.7, 0.9))
    for beyond in past:  # the torn face
        shows = torch.where(chance(0, 1) < 0.5, chance(0, 12), torch.zeros(())) * (1 + 0.35 * teeth(14)) * (1 - 0.5 * across**2)
        shows = torch.minimum(shows, 1.6 * half)
        floor = floor + torch.sigmoid((shows - beyond) / 0.4) * (shows > 1) * (wire * chance(0.05, 0.6) * fine.clamp(min=0.1) - floor)
    return painted + gone * (floor - painted)


def paint(details, what):
    """Details `[n, row, column, (gray/16 - 1, deviation/4 bins)]`, each with one of what is asked for somewhere about its middle."""
    n, sides = len(details), (AT[None, None, :], AT[None, :, None])
    chance = lambda low, high: torch.rand(n, 1, 1) * (high - low) + low
    log_chance = lambda low, high: torch.exp(chance(math.log(low), math.log(high)))
    angle = lambda: chance(0, 2 * math.pi)
    edge = lambda r, width: torch.sigmoid((1 - r) / width * 2)
    # Smooth fields of chance with so many cells a side.
    rough = lambda cells: F.interpolate(torch.randn(n, 1, cells, cells), (SIDE, SIDE), mode="bicubic", align_corners=False)[:, 0]
    dot = lambda px, py, sx, sy: torch.exp(-((sides[0] - px) ** 2) / (2 * sx**2) - (sides[1] - py) ** 2 / (2 * sy**2))
    # Where a value or one beside it is known; 0 stands for what is not, and now and then for a 0.
    seen, known = (F.max_pool2d((layer != 0).float()[:, None], 3, 1, 1)[:, 0] for layer in (details[..., 0], details[..., 1]))
    gray = (details[..., 0] + 1) * 16
    light = gray / torch.clamp(32 - gray, min=0.5)

    # A spot: its radius, and how far every place is from its middle in radii.
    radius = log_chance(4.0, 30.0)
    middle_x, middle_y = chance(-1, 1) * torch.clamp(radius * 0.8, max=8), chance(-1, 1) * torch.clamp(radius * 0.9, max=10)
    x, y = sides[0] - middle_x, sides[1] - middle_y
    turn, longer = chance(0, math.pi), torch.exp(0.25 * torch.randn(n, 1, 1))
    along, across = x * torch.cos(turn) + y * torch.sin(turn), -x * torch.sin(turn) + y * torch.cos(turn)
    away, fine = torch.sqrt(along**2 * longer + across**2 / longer) / radius, rough(22)
    if what == BURN:
        ragged = chance(0, 0.16) * chance(0, 1.6)
    elif what == DROP:
        ragged = chance(0, 0.05)
    else:
        ragged = chance(0.05, 0.35)
    r = away + ragged * (torch.where(radius < 12, rough(13), rough(7)) + 0.4 * fine)

    if what == BURN:  # a crater, a rim that is brighter towards the lamp, and a tarnished halo
        crater, halo_to = edge(r, chance(0.03, 0.22)), chance(1.3, 2.3)
        rim = torch.exp(-(((r - chance(0.85, 1.25)) / chance(0.08, 0.35)) ** 2))
        rim = rim * (1 + chance(0, 0.9) * torch.cos(torch.atan2(y, x) - angle()))
        halo = torch.clamp((halo_to - r) / (halo_to - 1), 0, 1)
        painted = light * (1 - halo * chance(-0.05, 0.4)) * (1 - crater * chance(0.15, 0.8)) * (1 + 0.6 * crater * chance(0, 0.35) * rough(40))
        painted = painted + rim * log_chance(0.12, 1.1) * (0.75 * light + 0.25 * light.clamp(0, 1.5))
    elif what == DROP:  # a lens that turns what is behind it over, with a dark outline and one or two bright dots
        inside, turned = edge(r, chance(0.02, 0.08)), chance(0, 0.9)
        outline = torch.exp(-(((r - chance(0.9, 1.02)) / chance(0.04, 0.15)) ** 2)) * chance(-0.12, 0.45)
        size = radius * chance(0.08, 0.3) + 0.8
        place = lambda reach: (middle_x + radius * chance(-reach, reach), middle_y + radius * chance(-reach, reach))
        dots = dot(*place(0.6), size, size * chance(0.7, 1.4)) * chance(0.4, 3.2)
        size = size * chance(0.5, 1.5)
        dots = dots + dot(*place(0.8), size, size * chance(0.7, 1.4)) * chance(0, 1)
        lens = light + inside * turned * (light.flip(1, 2) - light)
        tilt = chance(0, 0.35) * (x * torch.cos(angle()) + y * torch.sin(angle())) / radius
        painted = lens * (1 - inside * (1 - chance(0.5, 1.08) * (1 + tilt))) * (1 - outline) + inside * dots
    elif what == DARK:  # tar and grease, now and then with a gleam
        blob = edge(r, chance(0.03, 0.4))
        at = (middle_x + radius * chance(-0.5, 0.5), middle_y + radius * chance(-0.5, 0.5))
        gleam = dot(*at, radius * chance(0.05, 0.2) + 0.7, radius * chance(0.1, 0.5) + 1) * chance(0, 1) * (chance(0, 1) > 0.6)
        painted = light * (1 - blob * chance(0.25, 0.92) * (1 + 0.15 * fine)) + blob * gleam
    elif what == BRIGHT:  # lime and paint
        painted = light * (1 + edge(r, chance(0.03, 0.4)) * chance(0.15, 1.2) * (1 + 0.3 * fine))
    elif what == GAP:
        painted = gap(details, light, sides, chance, log_chance, rough)
    elif what == FIBRES:  # one or two, bent or straight, bright or dark: rims without a crater
        painted = light
        for often in (1.0, 0.3):
            bend, width = log_chance(4.0, 150.0), log_chance(0.6, 1.8)
            towards, reach = angle(), log_chance(4.0, 26.0)
            from_x, from_y = x + bend * torch.cos(towards), y + bend * torch.sin(towards)
            turned = torch.remainder(torch.atan2(from_y, from_x) - towards + math.pi, 2 * math.pi) - math.pi
            ends = torch.sigmoid((reach - turned.abs() * bend) / 1.0)
            line = torch.exp(-(((torch.sqrt(from_x**2 + from_y**2) - bend) / width) ** 2)) * ends
            amount = log_chance(0.1, 0.9) * torch.where(chance(0, 1) < 0.6, 1.0, -1.0) * (chance(0, 1) < often)
            painted = painted * (1 + line * amount) + 0.15 * line * amount.clamp(min=0)
    else:  # specks of dirt
        speck = torch.sigmoid((0.7 * rough(40) + 0.5 * fine - chance(1.2, 1.9)) * 6) * torch.sigmoid((1.6 - away) / 0.2)
        painted = light * (1 - speck * chance(0.2, 0.8))

    painted = torch.maximum(painted, 0.03 * light)
    change, blur = 32 * painted / (1 + painted) - gray, chance(0, 0.25)  # the lens blurs it
    for axis in (1, 2):
        change = change * (1 - 2 * blur) + blur * (change.roll(1, axis) + change.roll(-1, axis))
    return torch.stack([details[..., 0] + seen * change / 16, details[..., 1] + known * change / 4], -1)
