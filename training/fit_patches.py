#!/usr/bin/env python3
"""Learns the network that looks at patches of the unrolled rope (src/vision/damage.rs), and writes its weights.

    pip install torch numpy
    cargo build --release --examples --bins
    python training/fit_patches.py --data DIR --intact ROPE_A:4 --intact ROPE_B:1.6 --out src/vision/damage.weights

Every rope is simulated by a seed of its own (construction, camera, light, dirt, foreign matter, looks of defects by chance), a model is
trained on its first 2.5 m, and the suspects on the rest are cut out (training/patches.rs). What they show say the labels
(training/ropes.py). Recordings of other cameras add what lies on their intact rope: either half of it is cut out by a model of
the other. Every fifth rope is held back and told every thousand steps.

The weights that are shipped were learnt in goes, each from the weights before (--from): 12,000 steps from chance, from 50 ropes with defects of
all kinds, 14 with burns alone and 16 with none, without patches laid over those of other cameras; 6,000 with them; 5,000 with 32 ropes more
whose gaps had bright floors; and 7,000 from 93 new ropes (54, 12, 13, 7 and 7 in the order of the options, --first-seed 60000) whose broken
wires have torn ends and shining, greasy or shadowed floors.
"""

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F

from networks import Convolution, begun, counts_of_defects, dense, descend, tell, write
from ropes import HEAD, KINDS, chosen_of, gathered

SHAPE = BLOCKS, PLACES, LAYERS = 28, 15, 10
SIZES = ((BLOCKS, PLACES), (14, 15), (7, 8), (4, 4))  # rows and columns of every layer's result
CHANNELS, LAST = (16, 32, 48), 32
LOOKS = torch.tensor([0, 0, 2, 2, 1, 2, 1, 2])  # of every kind: a wire is interrupted, stands out, has another surface
SCORE = 10.0  # score that counts 1
KIND_COUNTS = 0.3  # what telling kinds apart counts beside telling damage
DAMAGE_SHARE = 0.4  # what damage counts in all beside intact rope
ARC_COUNTS = 3  # what burns count beside other damage: small, rare, and like drops
PLAIN, DAMAGED = 400, 150  # patches of a step that show intact rope, and damage
OTHERS = 0.06  # share of intact patches that are of other cameras
LAID_OVER = 0.25  # share of simulated patches whose middle is laid over a patch of another camera


class Network(nn.Module):
    """The logarithm of the odds of damage, and those of its looks up to a sum."""

    def __init__(self):
        super().__init__()
        channels = (LAYERS, *CHANNELS)
        self.convolutions = nn.ModuleList(Convolution(*layer) for layer in zip(channels, channels[1:], SIZES, SIZES[1:]))
        self.tells = dense(2 * CHANNELS[-1] + 1, LAST, 1 + int(LOOKS.max()) + 1, 0.3)

    def forward(self, patches, score):
        seen = patches.permute(0, 3, 1, 2)
        for convolution in self.convolutions:
            seen = convolution(seen)
        told = self.tells(torch.cat([seen[:, :, 1:3, 1:3].mean((2, 3)), seen.mean((2, 3)), score[:, None] / SCORE], 1))
        return told[:, 0], told[:, 1:]

    def heads(self):
        return (self.tells,)


def inputs(taught, at):
    """What the network sees of some suspects: their patches and scores."""
    values, head = taught
    return torch.from_numpy(values[at].astype(np.float32)), torch.from_numpy(head[at, HEAD.index("score")])


def laid_over(patches, others):
    """The same patches, of some of them only what is about the middle, on intact rope of another camera: else that camera would tell that there
    is no damage."""
    n = len(patches)
    chance = lambda low, high: torch.rand(n, 1, 1, 1) * (high - low) + low
    rows, columns = (torch.arange(of)[None] - (of - 1) / 2 for of in (BLOCKS, PLACES))
    far = torch.hypot(rows[:, :, None, None] / chance(5, 13), columns[:, None, :, None] / chance(3.5, 8))
    share = torch.where(torch.rand(n, 1, 1, 1) < LAID_OVER, torch.sigmoid((1 - far) * 8), torch.ones(()))
    expected = torch.where(share.amin((1, 2, 3), True) < 1, others[..., 2:5], patches[..., 2:5])
    mixed = others + share * (patches - others)
    return torch.cat([mixed[..., :2], expected, mixed[..., 5:]], 3)


def varied(patches):
    """The same patches mirrored, shifted, brighter or duller, noisier: none of that makes damage of what is none."""
    n = len(patches)
    some = lambda share: (torch.rand(n) < share)[:, None, None, None]
    turned = patches.flip(1)
    turned[..., 9] *= -1  # slant
    patches = torch.where(some(0.5), turned, patches)
    across = patches.flip(2)[..., [1, 0, 3, 2, *range(4, LAYERS)]]
    across[..., 9] *= -1
    patches = torch.where(some(0.5), across, patches)
    for shift in (-2, -1, 1, 2):
        moved = patches.roll(shift, 1)
        moved[:, :shift] = 0 if shift > 0 else moved[:, :shift]
        moved[:, shift:] = 0 if shift < 0 else moved[:, shift:]
        patches = torch.where(some(0.1), moved, patches)
    seen = patches[..., 4:5] > 0
    gray = patches[..., :2] * torch.exp(0.15 * torch.randn(n, 1, 1, 1))
    gray = gray + (0.04 * torch.randn(gray.shape) + some(0.3) * 0.12 * torch.randn(n, 1, 1, 1)) * seen
    further = patches[..., 5:] * torch.exp(0.12 * torch.randn(n, 1, 1, LAYERS - 5)) * (torch.rand(n, 1, 1, LAYERS - 5) >= 0.05)
    return torch.cat([gray, patches[..., 2:5], further], 3)


def learn(network, taught, of_others, held, steps):
    values, head, defect, kind = taught
    plain, damaged = (np.where(which)[0] for which in (defect < 0, defect >= 0))
    counts = counts_of_defects(defect[damaged])
    counts[torch.from_numpy(kind[damaged] == KINDS.index("arc_burn"))] *= ARC_COUNTS
    n_others = int(PLAIN * OTHERS) if of_others else 0
    is_damage = torch.zeros(PLAIN + DAMAGED)
    is_damage[PLAIN:] = 1
    weight = torch.where(is_damage > 0, DAMAGE_SHARE * PLAIN / DAMAGED, 1.0)

    def loss_of(fast):
        at = plain[torch.randint(len(plain), (PLAIN - n_others,)).numpy()]
        of_damage = damaged[torch.multinomial(counts, DAMAGED, replacement=True).numpy()]
        patches, score = inputs((values, head), np.concatenate([at, of_damage]))
        if of_others:
            at = torch.randint(len(of_others[0]), (n_others + len(patches),)).numpy()
            theirs, their_score = inputs(of_others[::-1], at)
            patches = torch.cat([theirs[:n_others], laid_over(patches, theirs[n_others:])])
            score = torch.cat([their_score[:n_others], score])
        odds, looks = fast(varied(patches), score * torch.exp(0.1 * torch.randn(len(score))))
        loss = F.binary_cross_entropy_with_logits(odds, is_damage, weight=weight)
        of_kind = F.cross_entropy(looks[PLAIN:], LOOKS[torch.from_numpy(kind[of_damage])])
        return loss + KIND_COUNTS * DAMAGE_SHARE * PLAIN / (PLAIN + DAMAGED) * of_kind

    descend(network, steps, 6e-3, loss_of, lambda: tell_held(network, held))


@torch.no_grad()
def tell_held(network, held):
    values, head, defect, kind = held
    network.eval()
    odds = np.concatenate([network(*inputs((values, head), slice(k, k + 4096)))[0].numpy() for k in range(0, len(defect), 4096)])
    network.train()
    for name, odds in (("scores", head[:, HEAD.index("score")]), ("as it is", head[:, HEAD.index("odds")]), ("patches", odds)):
        tell(name, odds, defect, kind, KINDS)


def main():
    chosen = chosen_of(__doc__, (66, 14, 16, 8, 8), 12000, f"{PLAIN + DAMAGED} patches")
    torch.manual_seed(0)
    halved = lambda patches: patches.astype(np.float16)
    taught, of_others, held = gathered("patches", chosen, SHAPE, halved)
    network = begun(Network(), chosen.begin, *inputs(taught[:2], slice(1000)))
    learn(network, taught, of_others, held, chosen.steps)
    write(network, chosen.out, chosen.begin, chosen.keep)


if __name__ == "__main__":
    main()
