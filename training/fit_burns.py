#!/usr/bin/env python3
"""Learns the network that sees burns in details of the image (src/vision/burn.rs), and writes its weights.

    pip install jax optax numpy
    cargo build --release --examples --bins
    python training/fit_burns.py --ropes 42 --burnt-ropes 16 --data DIR --intact ROPE_A:4 --intact ROPE_B:1.6 --out src/vision/burn.weights

Ropes as in training/fit.py, most of them with defects of all kinds, some with burns alone. Details of their suspects (training/patches.rs) show
burns or intact rope; those of other damage are left out. On intact ones, among them those of other cameras, which count four times, burns are
painted, and what may be taken for one (training/paint.py). Every fifth rope is held back and told after every epoch.

The weights that are shipped were learnt in goes, each from the weights before (--from), by details 6.4 mm wide of which the middle was shown:
4 epochs from 34 ropes with all damage told from the rest, 14 with burns alone, and 12 more with 13 burnt ropes beside them; 11 ropes were
held back.
"""

import argparse
import json
import pickle
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax

import fit
from paint import BRIGHT, BURN, DARK, DROP, NOTHING, SIDE, SPECKS, paint

SHOWN = slice(8, 56)  # of a detail; the rest is there to be shifted in
CHANNELS, LAST = (12, 24, 32, 48), 32
fit.METRES, fit.DEFECTS = 8, 36
HEAD = 5
SCALE = np.array([1 / 127, 1 / 32], np.float32)  # details are kept in bytes
BURNS_SHARE = 0.1  # what simulated burns count in all beside intact rope; painted ones count as what they are painted on
LESS = 1.0  # what is told counts so much less: then one intact suspect in a thousand reaches no more by details than by patches
PAINTED = {BURN: 0.25, DROP: 0.09, DARK: 0.06, BRIGHT: 0.03, SPECKS: 0.04}  # shares of intact details


def cut(recording, model, data, program):
    """Head (view, line, column, score, log odds) of every detail, and the details."""
    fit.run(program.parent / "examples" / "patches", "details", recording, model, data / "details.f32")
    rows = np.fromfile(data / "details.f32", "<f4").reshape(-1, HEAD + SIDE * SIDE * 2)
    return rows[:, :HEAD], np.clip(rows[:, HEAD:].reshape(-1, SIDE, SIDE, 2) / SCALE, -127, 127).round().astype(np.int8)


def details(seed, data, program, burnt):
    """Details of a simulated rope, and whether they show a burn (its number) or intact rope (-1)."""
    folder, kept = data / f"rope{seed}", data / f"details{seed}.npz"
    if not kept.exists():
        only = ["--defect-kind", "arc_burn"] if burnt else []
        fit.run(program, "simulate", "--force", "--out", folder, *fit.options(seed), *only)
        (data / "rope.model").unlink(missing_ok=True)
        fit.run(program, "train", folder, "--to-m", fit.TRAIN_M, "--out", data / "rope.model")
        head, values = cut(folder, data / "rope.model", data, program)
        view, line, column, *_ = head.T
        burn, told = np.full(len(head), -1), line > (fit.TRAIN_M * 1000 + 100) * 10
        for label in json.loads((folder / "labels.json").read_text()):
            along = lambda pad: (view == label["view"]) & (line >= label["first_line"] - pad) & (line <= label["last_line"] + pad)
            inside = along(5) & (column >= label["first_column"] - 6) & (column <= label["last_column"] + 6)
            shows = inside & label["clear"] & (label["kind"] == "arc_burn")
            burn[shows] = seed * 1000 + label["defect"]
            told &= ~along(120) | shows | (burn >= 0)
        np.savez(kept, values=values[told], head=head[told], burn=burn[told])
        fit.run("rm", "-r", folder)
    found = np.load(kept)
    return found["values"], found["head"], found["burn"]


def intact(recording, to_m, data, program):
    """Details of intact rope: of either half of a recording up to a metre, by a model of the other."""
    parts = []
    for taught, (from_m, end_m) in ((0, to_m / 2), (to_m / 2, to_m)), ((to_m / 2, to_m), (0, to_m / 2)):
        (data / "rope.model").unlink(missing_ok=True)
        fit.run(program, "train", recording, "--from-m", taught[0], "--to-m", taught[1], "--out", data / "rope.model")
        head, values = cut(recording, data / "rope.model", data, program)
        told = (head[:, 1] > (from_m + 0.01) * 10000) & (head[:, 1] < (end_m - 0.01) * 10000)
        parts.append((values[told], head[told], np.full(told.sum(), -1)))
    return tuple(np.concatenate(part) for part in zip(*parts))


def start(key):
    """Weights by chance: kernel or matrix, offset, and for convolutions the factor after normalisation."""
    channels = (2, *CHANNELS)
    shapes = [(3, 3, *pair) for pair in zip(channels, CHANNELS)] + [(2 * CHANNELS[-1], LAST), (LAST, 1)]
    layers = []
    for key, shape in zip(jax.random.split(key, len(shapes)), shapes):
        scale = np.sqrt(2 / np.prod(shape[:-1])) * (0.3 if shape[-1] == 1 else 1.0)
        layers.append([jax.random.normal(key, shape) * scale, jnp.zeros(shape[-1])] + [jnp.ones(shape[-1])] * (len(shape) == 4))
    return layers, [(jnp.zeros(k), jnp.ones(k)) for k in CHANNELS]


def log_odds(layers, values, usual=None):
    """The logarithm of the odds of a burn; mean and variance of the channels are the `usual` ones or, without them, those of the batch."""
    leak, found, seen = lambda x: jnp.where(x > 0, x, 0.1 * x), [], values[:, SHOWN, SHOWN]
    for n, (kernel, offset, factor) in enumerate(layers[: len(CHANNELS)]):
        seen = jax.lax.conv_general_dilated(seen, kernel, (2, 2), "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC"))
        mean, variance = usual[n] if usual else (seen.mean((0, 1, 2)), seen.var((0, 1, 2)))
        found.append((mean, variance))
        seen = leak((seen - mean) * factor / jnp.sqrt(variance + 1e-3) + offset)
    seen = jnp.concatenate([seen[:, 1, 1], seen.max((1, 2))], 1)
    (weights, offset), (result, of_result) = layers[len(CHANNELS) :]
    return (leak(seen @ weights + offset) @ result + of_result)[:, 0], found


def varied(rng, values):
    """The same details mirrored, shifted, in other light, noisier, at the end of a recording: none of that makes a burn of what is none."""
    n = len(values)
    for axis in (1, 2):
        mirrored = rng.random(n) < 0.5
        values[mirrored] = np.flip(values[mirrored], axis)
    for k in np.where(rng.random(n) < 0.5)[0]:
        (down, right), shifted = rng.integers(-6, 7, 2), np.zeros_like(values[k])
        to, of = (lambda by: slice(max(by, 0), SIDE + min(by, 0))), (lambda by: slice(max(-by, 0), SIDE + min(-by, 0)))
        shifted[to(down), to(right)] = values[k][of(down), of(right)]
        values[k] = shifted
    for k in np.where(rng.random(n) < 0.06)[0]:
        ends = rng.integers(SIDE // 2)
        values[k, slice(ends) if rng.random() < 0.5 else slice(SIDE - ends, SIDE)] = 0
    seen = values != 0
    values[..., 1] *= np.exp(rng.normal(0, 0.2, (n, 1, 1))).astype(np.float32)
    light = np.exp(rng.normal(0, 0.12, (n, 1, 1))).astype(np.float32)
    values[..., 0] = np.where(seen[..., 0], (values[..., 0] + 1) * light - 1, 0)
    return values + rng.normal(0, 0.03, values.shape).astype(np.float32) * seen


def weights_of(burn):
    """Every burn counts by the root of its details, all together a share of intact rope."""
    counts, burnt = np.ones(len(burn), np.float32), burn >= 0
    _, which, of_each = np.unique(burn, return_inverse=True, return_counts=True)
    counts[burnt] = 1 / np.sqrt(of_each[which[burnt]])
    counts[burnt] *= BURNS_SHARE * (~burnt).sum() / counts[burnt].sum()
    return counts


def learn(taught, held, layers, usual, epochs, seed, batch=384):
    values, _, burn = taught
    counts, rng, painting = weights_of(burn), np.random.default_rng(seed), jax.jit(paint)
    optimiser = optax.adamw(optax.cosine_decay_schedule(3e-3, epochs * len(burn) // batch), weight_decay=1e-2)
    state = optimiser.init(layers)

    @jax.jit
    def step(layers, state, usual, values, burnt, counts):
        def loss(layers):
            odds, found = log_odds(layers, values)
            return (counts * optax.sigmoid_binary_cross_entropy(odds, burnt)).mean(), found
        (value, found), slope = jax.value_and_grad(loss, has_aux=True)(layers)
        change, state = optimiser.update(slope, state, layers)
        usual = jax.tree.map(lambda usual, found: 0.98 * usual + 0.02 * found, usual, found)
        return optax.apply_updates(layers, change), state, usual, value

    for epoch in range(epochs):
        order, losses = rng.permutation(len(burn)), []
        for first in range(0, len(order) - batch + 1, batch):
            at = order[first : first + batch]
            what = rng.choice([NOTHING, *PAINTED], batch, p=[1 - sum(PAINTED.values()), *PAINTED.values()])
            what[burn[at] >= 0] = NOTHING
            shown = np.array(painting(jax.random.PRNGKey(rng.integers(1 << 30)), values[at] * SCALE, what))
            burnt = ((burn[at] >= 0) | (what == BURN)).astype(np.float32)
            layers, state, usual, loss = step(layers, state, usual, varied(rng, shown), burnt, counts[at])
            losses.append(float(loss))
        print(f"epoch {epoch + 1} of {epochs}: loss {np.mean(losses):.4f}", flush=True)
        tell(layers, usual, held)
    return layers, usual


def tell(layers, usual, held):
    values, head, burn = held
    told = jax.jit(lambda values: log_odds(layers, values, usual)[0])
    odds = np.concatenate([told(values[k : k + 1024] * SCALE) for k in range(0, len(burn), 1024)])
    for name, odds in (("patches alone", head[:, 4]), ("details alone", odds), ("the higher", np.maximum(head[:, 4], odds))):
        over = [100 * (odds[burn >= 0] > np.quantile(odds[burn < 0], 1 - false)).mean() for false in (0.1, 0.01, 0.001)]
        print(f"  {name}: {over[0]:.1f}, {over[1]:.1f}, {over[2]:.1f} % of the burns over 10, 1, 0.1 % of the rest", flush=True)


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--ropes", type=int, default=42, help="ropes with defects of all kinds")
    words.add_argument("--burnt-ropes", type=int, default=16, help="ropes with burns alone")
    words.add_argument("--first-seed", type=int, default=3000, help="of the ropes; burnt ones begin 1000 later")
    words.add_argument("--epochs", type=int, default=30)
    words.add_argument("--program", type=Path, default=Path("target/release/ropescope"))
    words.add_argument("--intact", action="append", default=[], metavar="RECORDING:TO_M", help="rope without damage, seen by another camera")
    words.add_argument("--from", dest="begin", type=Path, help="weights to go on from, as --keep wrote them")
    words.add_argument("--keep", type=Path, help="file for weights to go on from")
    words.add_argument("--data", type=Path, required=True, help="folder for details; those that are there are used again")
    words.add_argument("--out", type=Path, required=True)
    chosen = words.parse_args()
    chosen.data.mkdir(parents=True, exist_ok=True)
    ropes = [(chosen.first_seed + k, False) for k in range(chosen.ropes)]
    ropes += [(chosen.first_seed + 1000 + k, True) for k in range(chosen.burnt_ropes)]
    of = lambda wanted: [details(seed, chosen.data, chosen.program, burnt) for seed, burnt in ropes if wanted(seed)]
    pooled = lambda parts: [np.concatenate(part) for part in zip(*parts)]
    others = [intact(recording, float(to_m), chosen.data, chosen.program) for recording, to_m in (of.rsplit(":", 1) for of in chosen.intact)]
    taught, held = pooled(of(lambda seed: seed % 5 != 3) + 4 * others), pooled(of(lambda seed: seed % 5 == 3))
    layers, usual = pickle.loads(chosen.begin.read_bytes()) if chosen.begin else start(jax.random.PRNGKey(0))
    layers, usual = learn(taught, held, layers, usual, chosen.epochs, 0)
    if chosen.keep:
        chosen.keep.write_bytes(pickle.dumps(jax.tree.map(np.asarray, (layers, usual))))
    numbers = []
    for (kernel, offset, factor), (mean, variance) in zip(layers, usual):  # normalisation becomes part of the convolution
        factor = factor / jnp.sqrt(variance + 1e-3)
        numbers += [kernel * factor, offset - mean * factor]
    numbers += [part for layer in layers[len(CHANNELS) :] for part in layer]
    numbers[-1] = numbers[-1] - LESS
    np.concatenate([np.asarray(part, "<f4").ravel() for part in numbers]).tofile(chosen.out)


if __name__ == "__main__":
    main()
