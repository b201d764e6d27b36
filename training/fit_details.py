#!/usr/bin/env python3
"""Learns the network that looks at details of the image (src/vision/detail_network.rs), and writes its weights.

    pip install torch numpy
    cargo build --release --examples --bins
    python training/fit_details.py --data DIR --intact ROPE_A:4 --intact ROPE_B:1.6 --out src/vision/detail.weights

Ropes as in training/fit_patches.py, most of them with defects of all kinds, some with burns or gaps alone, some with none. Details of their
suspects (training/patches.rs) show damage or intact rope. It learns two things of them: how far to believe what the patch of a suspect
told, from all of them, and from gaps that are painted on intact details, among them those of other cameras (training/paint.py); and whether
there is a burn, from simulated and painted ones. What may be taken for either is painted, too. Every fifth rope is held back and told every
thousand steps.

The weights that are shipped were learnt in goes, each from the weights before (--from), beside the patches' network of before: 9,000 steps
of burns alone and 6,000 of both from 42 and 16 ropes, whose labels missed some damage that other views show; then 6,500 of both without that,
with 16 intact ropes and painted fibres beside them; then, beside the patches' network as it is, 5,000 smaller ones with painted gaps from 80
new ropes (48, 12, 13 and 7 in the order of the options, --first-seed 60000), of which three tenths of the weights before were kept (--keep
0.3): the mean of both told more of what was held back than either.
"""

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F

from networks import Convolution, begun, counts_of_defects, dense, descend, tell, write
from paint import BRIGHT, BURN, DARK, DROP, FIBRES, GAP, SIDE, SPECKS, paint
from ropes import HEAD, KINDS, chosen_of, gathered

CUT = 64  # sides of the details that are cut out: the network looks at less, so that there is something to shift in
CHANNELS, LAST = (16, 32, 48, 64), 32
SIZES = [(SIDE >> layer, SIDE >> layer) for layer in range(len(CHANNELS) + 1)]  # rows and columns of every layer's result
OF_PATCHES = [HEAD.index("odds"), HEAD.index("score")]
TOLD = torch.tensor([4.0, 10.0])  # log odds of a patch, and score, that count 1
SCALE = np.array([1 / 127, 1 / 32], np.float32)  # details are kept in bytes
PAINTED = {BURN: 100, GAP: 60, DROP: 40, FIBRES: 30, DARK: 24, BRIGHT: 12, SPECKS: 14}  # details of a step that are painted on
PAINT_COUNTS = 0.4  # what they count beside others, where damage is told
PATCHES_DOUBT = (-4.0, 4.0)  # what patches tell of what is painted, by chance: where they are sure, they are believed
BURNS, PLAIN, DAMAGED = 24, 230, 90  # details of a step that show simulated burns, intact rope as it is, and other damage
OTHERS = 0.06  # share of intact details that are of other cameras
DAMAGE_SHARE = 0.4  # what damage counts in all beside intact rope, as in training/fit_patches.py


class Network(nn.Module):
    """The logarithms of the odds of a burn, and of any damage of what the patch took to be so likely."""

    def __init__(self):
        super().__init__()
        channels = (2, *CHANNELS)
        self.convolutions = nn.ModuleList(Convolution(*layer) for layer in zip(channels, channels[1:], SIZES, SIZES[1:]))
        self.of_burn, self.of_damage = dense(2 * CHANNELS[-1], LAST, 1, 0.3), dense(2 * CHANNELS[-1] + 2, LAST, 1, 0.1)

    def forward(self, details, told):
        seen = details.permute(0, 3, 1, 2)
        for convolution in self.convolutions:
            seen = convolution(seen)
        seen = torch.cat([seen[:, :, 1, 1], seen.amax((2, 3))], 1)
        return self.of_burn(seen)[:, 0], told[:, 0] + self.of_damage(torch.cat([seen, told / TOLD], 1))[:, 0]

    def heads(self):
        return (self.of_burn, self.of_damage)


def inputs(taught, at):
    """What the network sees of some suspects: the middles of their details, and what is told of them beside."""
    (values, head), middle = taught, slice((CUT - SIDE) // 2, (CUT + SIDE) // 2)
    return torch.from_numpy(values[at, middle, middle].astype(np.float32) * SCALE), torch.from_numpy(head[at][:, OF_PATCHES])


def shown(values, at):
    """Details, of which the middle is shown, or somewhat beside it."""
    n = len(at)
    first = (CUT - SIDE) // 2 + torch.randint(-6, 7, (2, n)) * (torch.rand(n) < 0.6)
    rows, columns = (first[axis][:, None] + torch.arange(SIDE) for axis in (0, 1))
    details = torch.from_numpy(values[at].astype(np.float32) * SCALE)
    return details[torch.arange(n)[:, None, None], rows[:, :, None], columns[:, None, :]]


def varied(details):
    """The same details mirrored, in other light, noisier, at the end of a recording: none of that makes a burn of what is none."""
    n = len(details)
    for axis in (1, 2):
        details = torch.where((torch.rand(n) < 0.5)[:, None, None, None], details.flip(axis), details)
    for k in torch.where(torch.rand(n) < 0.05)[0].tolist():
        ends = int(torch.randint(SIDE // 2 - 2, (1,)))
        details[k, slice(ends) if torch.rand(1) < 0.5 else slice(SIDE - ends, SIDE)] = 0
    seen, light = details != 0, torch.exp(0.12 * torch.randn(n, 1, 1))
    gray = torch.where(seen[..., 0], (details[..., 0] + 1) * light - 1, torch.zeros(()))
    details = torch.stack([gray, details[..., 1] * torch.exp(0.2 * torch.randn(n, 1, 1))], -1)
    return details + 0.03 * torch.randn(details.shape) * seen


def learn(network, taught, of_others, held, steps):
    values, head, defect, kind = taught
    burnt = kind == KINDS.index("arc_burn")
    plain, burns, damaged = (np.where(which)[0] for which in (defect < 0, burnt, (defect >= 0) & ~burnt))
    told_of = lambda head: torch.from_numpy(head[:, OF_PATCHES])

    def drawn(which, counts, n):
        at = which[torch.multinomial(counts, n, replacement=True).numpy()]
        return shown(values, at), told_of(head[at])

    def undamaged(n):
        n_others = int(n * OTHERS) if of_others else 0
        at = plain[torch.randint(len(plain), (n - n_others,)).numpy()]
        parts = [(shown(values, at), told_of(head[at]))]
        if n_others:
            at = torch.randint(len(of_others[0]), (n_others,)).numpy()
            parts.append((shown(of_others[1], at), told_of(of_others[0][at])))
        return tuple(torch.cat(part) for part in zip(*parts))

    of_burns, of_damaged = counts_of_defects(defect[burns]), counts_of_defects(defect[damaged])
    painted_on, n_painted = list(PAINTED.items()), sum(PAINTED.values())
    # In the order of a step: painted ones (burns first, then gaps), simulated burns, intact ones, other damage.
    is_burn = torch.zeros(n_painted + BURNS + PLAIN)
    is_burn[: PAINTED[BURN]], is_burn[n_painted : n_painted + BURNS] = 1, 1
    is_damage = torch.zeros(n_painted + BURNS + PLAIN + DAMAGED)
    is_damage[: PAINTED[BURN] + PAINTED[GAP]] = 1
    is_damage[n_painted : n_painted + BURNS], is_damage[n_painted + BURNS + PLAIN :] = 1, 1
    weight = torch.where(is_damage > 0, DAMAGE_SHARE * PLAIN / (BURNS + DAMAGED), 1.0)
    weight[:n_painted] = PAINT_COUNTS
    weight[: PAINTED[BURN]] = 0  # for these there is the other result
    cost = F.binary_cross_entropy_with_logits

    def doubted(n):
        """What is told of painted ones beside: of all of them alike, so that nothing but the image tells which are damaged."""
        odds, score = PATCHES_DOUBT[0] + (PATCHES_DOUBT[1] - PATCHES_DOUBT[0]) * torch.rand(n), head[:, HEAD.index("score")]
        return torch.stack([odds, torch.from_numpy(score[damaged[torch.multinomial(of_damaged, n, replacement=True).numpy()]])], 1)

    def loss_of(fast):
        parts = [(paint(undamaged(n)[0], what), doubted(n)) for what, n in painted_on]
        parts += [drawn(burns, of_burns, BURNS), undamaged(PLAIN), drawn(damaged, of_damaged, DAMAGED)]
        seen, told = (torch.cat(part) for part in zip(*parts))
        burn, damage = fast(varied(seen), told)
        return cost(burn[: len(is_burn)], is_burn) + cost(damage, is_damage, weight=weight)

    descend(network, steps, 2e-3, loss_of, lambda: tell_held(network, held))


@torch.no_grad()
def tell_held(network, held):
    values, head, defect, kind = held
    network.eval()
    parts = [torch.stack(network(*inputs((values, head), slice(k, k + 1024))), 1).numpy() for k in range(0, len(defect), 1024)]
    network.train()
    burn, damage = np.concatenate(parts).T
    patches = head[:, HEAD.index("odds")]
    for name, odds in (("patches", patches), ("burns", burn), ("details", damage), ("the higher of both", np.maximum(burn, damage))):
        tell(name, odds, defect, kind, KINDS)


def main():
    chosen = chosen_of(__doc__, (42, 16, 16, 0, 0), 15000, f"{sum(PAINTED.values()) + BURNS + PLAIN + DAMAGED} details")
    torch.manual_seed(0)
    in_bytes = lambda details: np.clip(details / SCALE, -127, 127).round().astype(np.int8)
    taught, of_others, held = gathered("details", chosen, (CUT, CUT, 2), in_bytes)
    network = begun(Network(), chosen.begin, *inputs(taught[:2], slice(2000)))
    learn(network, taught, of_others, held, chosen.steps)
    write(network, chosen.out, chosen.begin, chosen.keep)


if __name__ == "__main__":
    main()
