#!/usr/bin/env python3
"""Learns the network of the closer look (src/vision/damage.rs) from simulated ropes, and writes its weights.

    pip install jax optax numpy
    cargo build --release --examples --bins
    python training/fit.py --ropes 50 --data DIR --intact ROPE_A:4 --intact ROPE_B:1.6 --out src/vision/damage.weights

Every rope is simulated by a seed of its own (construction, camera, light, dirt, foreign matter, looks of defects by chance), a model is
trained on its first 2.5 m, and the suspects on the rest are cut out (training/patches.rs). A suspect within a clear label shows damage;
one near a label or in an unclear one is left out; all others show intact rope and what lies on it. Recordings of other cameras add what
lies on their intact rope: either half of it is cut out by a model of the other. Every fifth rope is held back and told at the end.

The weights that are shipped were learnt in goes, each from the weights before (--from): 40 epochs from 94 ropes with 1,800 defects, simulated
while the kinds of foreign matter grew from three to eight, all seen by one kind of camera; 6 epochs from 29 ropes as they are simulated
here; 5 from 39 of them, 750 defects, and from the intact metres of the samples rope-a (0 to 4) and rope-b, which counted twice; and 4
of the same, counting as below, from the mean of the weights before and after the 5. Patches of simulated ropes were cut out stretch by stretch then.
"""

import argparse
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax

from ropes import KINDS, TRAIN_M, options, run

BLOCKS, PLACES, LAYERS = 28, 15, 10
ROW = 5 + BLOCKS * PLACES * LAYERS
CHANNELS = (10, 20, 32, 24)
METRES, DEFECTS = 6, 20
LOOKS = np.array([0, 0, 2, 2, 1, 2, 1, 2])  # of every kind: a wire is interrupted, stands out, has another surface
KIND_COUNTS = 0.3  # what telling kinds apart counts beside telling damage
DAMAGE_SHARE = 0.4  # what damage counts in all beside intact rope
ARC_COUNTS = 3  # what burns count beside other damage: small, rare, and like drops


def cut(recording, model, data, program):
    """View, line, column, score of all suspects of a recording, and their patches, by a model."""
    run(program.parent / "examples" / "patches", "patches", recording, model, data / "patches.f32")
    rows = np.fromfile(data / "patches.f32", "<f4").reshape(-1, ROW)
    return rows[:, :4].T, rows[:, 5:].reshape(-1, BLOCKS, PLACES, LAYERS).astype(np.float16)


def intact(recording, to_m, data, program):
    """Patches of intact rope: of either half of a recording up to a metre, by a model of the other."""
    parts = []
    for taught, told_m in ((0, to_m / 2), (to_m / 2, to_m)), ((to_m / 2, to_m), (0, to_m / 2)):
        run(program, "train", recording, "--from-m", taught[0], "--to-m", taught[1], "--out", data / "rope.model")
        (view, line, _, score), values = cut(recording, data / "rope.model", data, program)
        told = (line > (told_m[0] + 0.01) * 10000) & (line < (told_m[1] - 0.01) * 10000)
        none = np.full(told.sum(), -1)
        parts.append((values[told], score[told], 0 * none, none, none, view[told], line[told]))
    return tuple(np.concatenate(part) for part in zip(*parts))


def patches(seed, data, program):
    """Patches, scores, whether they show damage, which defect and where, of one rope."""
    folder, kept = data / f"rope{seed}", data / f"rope{seed}.npz"
    if not kept.exists():
        run(program, "simulate", "--force", "--out", folder, *options(seed, METRES, DEFECTS))
        run(program, "train", folder, "--to-m", TRAIN_M, "--out", data / "rope.model")
        (view, line, column, score), values = cut(folder, data / "rope.model", data, program)
        damage, defect, kind = np.zeros(len(score), int), np.full(len(score), -1), np.full(len(score), -1)
        for label in json.loads((folder / "labels.json").read_text()):
            along = lambda pad: (view == label["view"]) & (line >= label["first_line"] - pad) & (line <= label["last_line"] + pad)
            inside = along(5) & (column >= label["first_column"] - 6) & (column <= label["last_column"] + 6)
            damage[along(120) & (damage == 0)] = -1
            damage[inside & (damage != 1)] = 1 if label["clear"] else -1
            defect[inside], kind[inside] = label["defect"], KINDS.index(label["kind"])
        told = (damage >= 0) & (line > (TRAIN_M * 1000 + 100) * 10)
        np.savez(kept, values=values[told], score=score[told], damage=damage[told], defect=seed * 1000 + defect[told], kind=kind[told], view=view[told], line=line[told])
        run("rm", "-r", folder)
    found = np.load(kept)
    return tuple(found[name] for name in ("values", "score", "damage", "defect", "kind", "view", "line"))


def start(key):
    """Weights by chance, in the order in which they are written."""
    first, second, third, last = CHANNELS
    shapes = [(3, 3, LAYERS, first), (3, 3, first, second), (3, 3, second, third), (2 * third + 1, last), (last, 1 + LOOKS.max() + 1)]
    layers = []
    for key, shape in zip(jax.random.split(key, len(shapes)), shapes):
        scale = np.sqrt(2 / np.prod(shape[:-1])) * (0.3 if shape[0] == last else 1.0)
        layers.append((jax.random.normal(key, shape) * scale, jnp.zeros(shape[-1])))
    return layers


def told(layers, values, score):
    """The logarithm of the odds of damage, and those of its looks up to a sum, of every patch."""
    leak = lambda x: jnp.where(x > 0, x, 0.1 * x)
    seen = values
    for (kernel, offset), stride in zip(layers[:3], ((2, 1), (2, 2), (2, 2))):
        seen = jax.lax.conv_general_dilated(seen, kernel, stride, "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC"))
        seen = leak(seen + offset)
    seen = jnp.concatenate([seen[:, 1:3, 1:3].mean((1, 2)), seen.mean((1, 2)), score[:, None] / 10], 1)
    (weights, offset), (result, of_result) = layers[3:]
    all_told = leak(seen @ weights + offset) @ result + of_result
    return all_told[:, 0], all_told[:, 1:]


def log_odds(layers, values, score):
    return told(layers, values, score)[0]


def varied(rng, values):
    """The same patches mirrored, shifted, brighter or duller, noisier: none of that makes damage of what is none."""
    values = values.astype(np.float32)
    n = len(values)
    mirrored = rng.random(n) < 0.5
    values[mirrored] = values[mirrored][:, ::-1]
    values[mirrored, :, :, 9] *= -1  # slant
    turned = rng.random(n) < 0.5
    across = values[turned][:, :, ::-1].copy()
    across[..., [0, 1, 2, 3]] = across[..., [1, 0, 3, 2]]
    across[..., 9] *= -1
    values[turned] = across
    values[..., :2] *= np.exp(rng.normal(0, 0.15, (n, 1, 1, 1))).astype(np.float32)
    for shift in (-2, -1, 1, 2):
        moved = np.where(rng.random(n) < 0.12)[0]
        shifted = np.roll(values[moved], shift, axis=1)
        shifted[:, :shift] = 0 if shift > 0 else shifted[:, :shift]
        shifted[:, shift:] = 0 if shift < 0 else shifted[:, shift:]
        values[moved] = shifted
    seen = values[..., 4:5] > 0
    values[..., :2] += rng.normal(0, 0.04, values[..., :2].shape).astype(np.float32) * seen
    lighter = rng.random(n) < 0.3
    values[lighter, :, :, :2] += rng.normal(0, 0.12, (int(lighter.sum()), 1, 1, 1)).astype(np.float32) * seen[lighter]
    for layer in range(5, LAYERS):
        values[rng.random(n) < 0.05, :, :, layer] = 0
    return values


def weights_of(damage, defect, kind):
    """Every defect counts by the root of its patches, damage in all a share of intact rope."""
    counts = np.ones(len(damage), np.float32)
    for number in np.unique(defect[damage == 1]):
        of_it = (defect == number) & (damage == 1)
        counts[of_it] = 1 / np.sqrt(of_it.sum())
    counts[(damage == 1) & (kind == KINDS.index("arc_burn"))] *= ARC_COUNTS
    counts[damage == 1] *= DAMAGE_SHARE * (damage == 0).sum() / counts[damage == 1].sum()
    return counts


def read(path):
    """Weights as they were written."""
    numbers, layers = np.fromfile(path, "<f4"), []
    for shapes in [[part.shape for part in layer] for layer in start(jax.random.PRNGKey(0))]:
        sizes = [int(np.prod(shape)) for shape in shapes]
        layers.append(tuple(jnp.asarray(part.reshape(shape)) for part, shape in zip(np.split(numbers[: sum(sizes)], sizes[:1]), shapes)))
        numbers = numbers[sum(sizes) :]
    return layers


def fit(taught, layers, epochs, seed, batch=512):
    values, score, damage, defect, kind, *_ = taught
    counts = weights_of(damage, defect, kind)
    rng = np.random.default_rng(seed)
    optimiser = optax.adamw(optax.cosine_decay_schedule(4e-3, epochs * len(score) // batch), weight_decay=1e-2)
    state = optimiser.init(layers)

    @jax.jit
    def step(layers, state, values, score, damage, kind, counts):
        def loss(layers):
            odds, looks = told(layers, values, score)
            of_kind = optax.softmax_cross_entropy_with_integer_labels(looks, jnp.asarray(LOOKS)[kind]) * damage
            return (counts * (optax.sigmoid_binary_cross_entropy(odds, damage) + KIND_COUNTS * of_kind)).mean()
        value, slope = jax.value_and_grad(loss)(layers)
        change, state = optimiser.update(slope, state, layers)
        return optax.apply_updates(layers, change), state, value

    for epoch in range(epochs):
        order, losses = rng.permutation(len(score)), []
        for first in range(0, len(order) - batch + 1, batch):
            at = order[first : first + batch]
            scores = score[at] * np.exp(rng.normal(0, 0.1, batch)).astype(np.float32)
            layers, state, loss = step(layers, state, varied(rng, values[at]), scores, damage[at], kind[at], counts[at])
            losses.append(float(loss))
        print(f"epoch {epoch + 1} of {epochs}: loss {np.mean(losses):.4f}", flush=True)
    return layers


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--ropes", type=int, default=50, help="ropes to simulate")
    words.add_argument("--first-seed", type=int, default=8000)
    words.add_argument("--epochs", type=int, default=40)
    words.add_argument("--program", type=Path, default=Path("target/release/ropescope"))
    words.add_argument("--intact", action="append", default=[], metavar="RECORDING:TO_M", help="rope without damage, seen by another camera")
    words.add_argument("--from", dest="begin", type=Path, help="weights to go on from")
    words.add_argument("--data", type=Path, required=True, help="folder for patches; those that are there are used again")
    words.add_argument("--out", type=Path, required=True)
    chosen = words.parse_args()
    chosen.data.mkdir(parents=True, exist_ok=True)
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.ropes)
    pooled = lambda ropes: [np.concatenate(parts) for parts in zip(*ropes)]
    others = [intact(recording, float(to_m), chosen.data, chosen.program) for recording, to_m in (of.rsplit(":", 1) for of in chosen.intact)]
    taught = pooled([patches(seed, chosen.data, chosen.program) for seed in seeds if seed % 5 != 3] + others)
    layers = read(chosen.begin) if chosen.begin else start(jax.random.PRNGKey(0))
    layers = fit(taught, layers, chosen.epochs, 0)
    np.concatenate([np.asarray(part, "<f4").ravel() for layer in layers for part in layer]).tofile(chosen.out)
    held = [patches(seed, chosen.data, chosen.program) for seed in seeds if seed % 5 == 3]
    if held:
        values, score, damage, *_ = pooled(held)
        odds = np.concatenate([log_odds(layers, jnp.asarray(values[k : k + 4096], jnp.float32), score[k : k + 4096]) for k in range(0, len(score), 4096)])
        for false in (0.1, 0.01, 0.001):
            over = np.quantile(odds[damage == 0], 1 - false)
            print(f"held back: {100 * (odds[damage == 1] > over).mean():.1f} % of the damage over {100 * false} % of the rest")


if __name__ == "__main__":
    main()
