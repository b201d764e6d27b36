#!/usr/bin/env python3
"""Learns the network that looks at details of the image (src/vision/detail_network.rs), and writes its weights.

    pip install torch numpy
    cargo build --release --examples --bins
    python training/fit_details.py --ropes 42 --burnt-ropes 16 --intact-ropes 16 --data DIR --intact ROPE_A:4 --intact ROPE_B:1.6 --out src/vision/detail.weights

Ropes as in training/fit.py, most of them with defects of all kinds, some with burns alone, some with none. Details of their suspects
(training/patches.rs) show damage or intact rope. It learns two things of them: how far to believe what the patch of a suspect told, from
all of them; and whether there is a burn, from simulated burns and from intact details, among them those of other cameras, on which burns
are painted, and what may be taken for one (training/paint.py). Every fifth rope is held back and told every thousand steps.

The weights that are shipped were learnt in goes, each from the weights before (--from): 9,000 steps of burns alone and 6,000 of both from 42
and 16 ropes, whose labels missed some damage that other views show; then 6,500 of both without that, with 16 intact ropes and painted
fibres beside them.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F

from paint import BRIGHT, BURN, DARK, DROP, FIBRES, SIDE, SPECKS, paint
from ropes import KINDS, TRAIN_M, options, run

CUT = 64  # sides of the details that are cut out: the network looks at less, so that there is something to shift in
CHANNELS, LAST = (16, 32, 48, 64), 32
METRES = 8
DAMAGE = {"all": (36, []), "burns": (36, ["--defect-kind", "arc_burn"]), "none": (0, [])}  # defects of a rope, and which
HEAD, SCORE, ODDS = 5, 3, 4  # what is told of a suspect beside its detail
TOLD = torch.tensor([4.0, 10.0])  # log odds of a patch, and score, that count 1
SCALE = np.array([1 / 127, 1 / 32], np.float32)  # details are kept in bytes
PAINTED = {BURN: 100, DROP: 40, FIBRES: 30, DARK: 24, BRIGHT: 12, SPECKS: 14}  # details of a step that are painted on
BURNS, PLAIN, DAMAGED = 24, 230, 90  # details of a step that show simulated burns, intact rope as it is, and other damage
OTHERS = 0.06  # share of intact details that are of other cameras
DAMAGE_SHARE = 0.4  # what damage counts in all beside intact rope, as in training/fit.py


def cut(recording, model, data, program):
    """Head (view, line, column, score, log odds) of every detail, and the details."""
    run(program.parent / "examples" / "patches", "details", recording, model, data / "details.f32")
    rows = np.fromfile(data / "details.f32", "<f4").reshape(-1, HEAD + CUT * CUT * 2)
    return rows[:, :HEAD], np.clip(rows[:, HEAD:].reshape(-1, CUT, CUT, 2) / SCALE, -127, 127).round().astype(np.int8)


def details(seed, data, program, damage):
    """Details of a simulated rope, their heads, the defect that they show (its number; -1 for intact rope), and its kind."""
    folder, kept = data / f"rope{seed}", data / f"details{seed}.npz"
    if not kept.exists():
        defects, which = DAMAGE[damage]
        run(program, "simulate", "--force", "--out", folder, *options(seed, METRES, defects), *which)
        (data / "rope.model").unlink(missing_ok=True)
        run(program, "train", folder, "--to-m", TRAIN_M, "--out", data / "rope.model")
        head, values = cut(folder, data / "rope.model", data, program)
        view, line, column, _, odds = head.T
        defect, kind, unclear = np.full(len(head), -1), np.full(len(head), -1), np.zeros(len(head), bool)
        for label in json.loads((folder / "labels.json").read_text()):
            along = lambda pad: (line >= label["first_line"] - pad) & (line <= label["last_line"] + pad)
            in_view = view == label["view"]
            shows = in_view & along(5) & (column >= label["first_column"] - 6) & (column <= label["last_column"] + 6)
            # About a defect other views may show it where nobody labelled it: what looks like damage there is left out.
            unclear |= (in_view & along(120)) | (along(200) & (odds > -2))
            if label["clear"]:
                defect[shows], kind[shows] = seed * 1000 + label["defect"], KINDS.index(label["kind"])
        told = (line > (TRAIN_M * 1000 + 100) * 10) & (~unclear | (defect >= 0))
        np.savez(kept, values=values[told], head=head[told], defect=defect[told], kind=kind[told])
        run("rm", "-r", folder)
    found = np.load(kept)
    return tuple(found[name] for name in ("values", "head", "defect", "kind"))


def intact(recording, to_m, data, program):
    """Details of intact rope, and their heads: of either half of a recording up to a metre, by a model of the other."""
    parts = []
    for taught, (from_m, end_m) in ((0, to_m / 2), (to_m / 2, to_m)), ((to_m / 2, to_m), (0, to_m / 2)):
        (data / "rope.model").unlink(missing_ok=True)
        run(program, "train", recording, "--from-m", taught[0], "--to-m", taught[1], "--out", data / "rope.model")
        head, values = cut(recording, data / "rope.model", data, program)
        told = (head[:, 1] > (from_m + 0.01) * 10000) & (head[:, 1] < (end_m - 0.01) * 10000)
        parts.append((values[told], head[told]))
    return tuple(np.concatenate(part) for part in zip(*parts))


class Network(nn.Module):
    """The logarithms of the odds of a burn, and of any damage of what the patch took to be so likely."""

    def __init__(self):
        super().__init__()
        pairs = list(zip((2, *CHANNELS), CHANNELS))
        self.convolutions = nn.ModuleList(nn.Conv2d(channels, to, 3, 2) for channels, to in pairs)
        self.usual = nn.ModuleList(nn.BatchNorm2d(to, eps=1e-3, momentum=0.02) for _, to in pairs)
        self.of_burn, self.of_damage = (
            nn.Sequential(nn.Linear(2 * CHANNELS[-1] + more, LAST), nn.LeakyReLU(0.1), nn.Linear(LAST, 1)) for more in (0, 2)
        )
        for layer in (*self.convolutions, *self.of_burn, *self.of_damage):
            if hasattr(layer, "weight"):
                nn.init.kaiming_normal_(layer.weight, 0.1)
                nn.init.zeros_(layer.bias)
        self.of_burn[-1].weight.data *= 0.3
        self.of_damage[-1].weight.data *= 0.1

    def forward(self, details, told):
        seen = details.permute(0, 3, 1, 2)
        for convolution, usual in zip(self.convolutions, self.usual):
            seen = F.leaky_relu(usual(convolution(F.pad(seen, (0, 1, 0, 1)))), 0.1)
        seen = torch.cat([seen[:, :, 1, 1], seen.amax((2, 3))], 1)
        return self.of_burn(seen)[:, 0], told[:, 0] + self.of_damage(torch.cat([seen, told / TOLD], 1))[:, 0]

    def numbers(self):
        """Weights as they are written; normalisation becomes part of the convolution."""
        for convolution, usual in zip(self.convolutions, self.usual):
            factor = usual.weight / torch.sqrt(usual.running_var + usual.eps)
            yield (convolution.weight * factor[:, None, None, None]).permute(2, 3, 1, 0)
            yield (convolution.bias - usual.running_mean) * factor + usual.bias
        for last, _, result in (self.of_burn, self.of_damage):
            for layer in (last, result):
                yield layer.weight.T
                yield layer.bias


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


def learn(network, taught, others, held, steps):
    values, head, defect, kind = taught
    burnt = kind == KINDS.index("arc_burn")
    plain, burns, damaged = (np.where(which)[0] for which in (defect < 0, burnt, (defect >= 0) & ~burnt))
    told_of = lambda head: torch.from_numpy(head[:, [ODDS, SCORE]])

    def counts(which):
        """Every defect counts by the root of its details."""
        _, each, of_each = np.unique(defect[which], return_inverse=True, return_counts=True)
        return torch.from_numpy(1 / np.sqrt(of_each[each]))

    def drawn(which, counts, n):
        at = which[torch.multinomial(counts, n, replacement=True).numpy()]
        return shown(values, at), told_of(head[at])

    def undamaged(n):
        of_others = int(n * OTHERS) if others else 0
        at = plain[torch.randint(len(plain), (n - of_others,)).numpy()]
        parts = [(shown(values, at), told_of(head[at]))]
        if of_others:
            at = torch.randint(len(others[0]), (of_others,)).numpy()
            parts.append((shown(others[0], at), told_of(others[1][at])))
        return tuple(torch.cat(part) for part in zip(*parts))

    of_burns, of_damaged = counts(burns), counts(damaged)
    painted_on, n_painted = list(PAINTED.items()), sum(PAINTED.values())
    # In the order of a step: painted ones (burns first), simulated burns, intact ones, other damage. Painted ones say nothing of patches.
    is_burn = torch.zeros(n_painted + BURNS + PLAIN)
    is_burn[: PAINTED[BURN]], is_burn[n_painted : n_painted + BURNS] = 1, 1
    is_damage = torch.zeros(BURNS + PLAIN + DAMAGED)
    is_damage[:BURNS], is_damage[BURNS + PLAIN :] = 1, 1
    weight = torch.where(is_damage > 0, DAMAGE_SHARE * PLAIN / (BURNS + DAMAGED), 1.0)

    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=1e-2)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=steps, pct_start=0.08)
    fast, cost, losses = torch.compile(network), F.binary_cross_entropy_with_logits, []
    for step in range(1, steps + 1):
        parts = [(paint(undamaged(n)[0], what), torch.zeros(n, 2)) for what, n in painted_on]
        parts += [drawn(burns, of_burns, BURNS), undamaged(PLAIN), drawn(damaged, of_damaged, DAMAGED)]
        seen, told = (torch.cat(part) for part in zip(*parts))
        burn, damage = fast(varied(seen), told)
        loss = cost(burn[: len(is_burn)], is_burn) + cost(damage[n_painted:], is_damage, weight=weight)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        rate.step()
        losses.append(loss.item())
        if step % 1000 == 0 or step == steps:
            print(f"step {step} of {steps}: loss {np.mean(losses[-1000:]):.4f}", flush=True)
            tell(network, held)


@torch.no_grad()
def tell(network, held):
    values, head, defect, kind = held
    middle = slice((CUT - SIDE) // 2, (CUT + SIDE) // 2)
    network.eval()
    parts = []
    for k in range(0, len(defect), 1024):
        seen = values[k : k + 1024, middle, middle].astype(np.float32) * SCALE
        parts.append(torch.stack(network(torch.from_numpy(seen), torch.from_numpy(head[k : k + 1024, [ODDS, SCORE]])), 1).numpy())
    network.train()
    burn, damage = np.concatenate(parts).T
    for name, odds in (("patches", head[:, ODDS]), ("burns", burn), ("details", damage), ("the higher of both", np.maximum(burn, damage))):
        over = [np.quantile(odds[defect < 0], 1 - false) for false in (0.01, 0.001)]
        shares = [100 * (odds[defect >= 0] > most).mean() for most in over]
        of_kinds = [f"{name} {100 * (odds[kind == k] > over[1]).mean():.0f}" for k, name in enumerate(KINDS)]
        print(f"  {name}: {shares[0]:.1f}, {shares[1]:.1f} % of the damage over 1, 0.1 % of the rest ({', '.join(of_kinds)})", flush=True)


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--ropes", type=int, default=42, help="ropes with defects of all kinds")
    words.add_argument("--burnt-ropes", type=int, default=16, help="ropes with burns alone")
    words.add_argument("--intact-ropes", type=int, default=16, help="ropes without defects")
    words.add_argument("--first-seed", type=int, default=3000, help="of the ropes; burnt ones begin 1000 later, intact ones 2000 later")
    words.add_argument("--steps", type=int, default=15000, help="each of 564 details")
    words.add_argument("--program", type=Path, default=Path("target/release/ropescope"))
    words.add_argument("--intact", action="append", default=[], metavar="RECORDING:TO_M", help="rope without damage, seen by another camera")
    words.add_argument("--from", dest="begin", type=Path, help="network to go on from, as --keep wrote it")
    words.add_argument("--keep", type=Path, help="file for a network to go on from")
    words.add_argument("--data", type=Path, required=True, help="folder for details; those that are there are used again")
    words.add_argument("--out", type=Path, required=True)
    chosen = words.parse_args()
    chosen.data.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    ropes = [(chosen.first_seed + k, "all") for k in range(chosen.ropes)]
    ropes += [(chosen.first_seed + 1000 + k, "burns") for k in range(chosen.burnt_ropes)]
    ropes += [(chosen.first_seed + 2000 + k, "none") for k in range(chosen.intact_ropes)]
    of = lambda wanted: [details(seed, chosen.data, chosen.program, damage) for seed, damage in ropes if wanted(seed)]
    pooled = lambda parts: [np.concatenate(part) for part in zip(*parts)]
    others = [intact(recording, float(to_m), chosen.data, chosen.program) for recording, to_m in (of.rsplit(":", 1) for of in chosen.intact)]
    taught, held = pooled(of(lambda seed: seed % 5 != 3)), pooled(of(lambda seed: seed % 5 == 3))
    network = Network().to(memory_format=torch.channels_last)
    if chosen.begin:
        network.load_state_dict(torch.load(chosen.begin))
    learn(network, taught, pooled(others) if others else None, held, chosen.steps)
    if chosen.keep:
        torch.save(network.state_dict(), chosen.keep)
    np.concatenate([np.asarray(part.detach(), "<f4").ravel() for part in network.numbers()]).tofile(chosen.out)


if __name__ == "__main__":
    main()
