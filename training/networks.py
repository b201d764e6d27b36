"""What the networks of the closer look are made of, as src/vision/layers.rs computes it, and how their weights are written."""

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F

LEAK = 0.1  # what negative values count after every layer


class Convolution(nn.Module):
    """3 x 3, with zeros about what it sees: as many rows and columns beyond either edge, one more beyond the far one where their number is odd."""

    def __init__(self, channels, to, seen, result):
        super().__init__()
        strides = [-(-of // into) for of, into in zip(seen, result)]
        beyond = [(into - 1) * stride + 3 - of for of, into, stride in zip(seen, result, strides)]
        rows, columns = ((all // 2, all - all // 2) for all in beyond)
        self.edges = (*columns, *rows)
        self.over = nn.Conv2d(channels, to, 3, strides)
        self.usual = nn.BatchNorm2d(to, eps=1e-3, momentum=0.02)
        nn.init.kaiming_normal_(self.over.weight, LEAK)
        nn.init.zeros_(self.over.bias)

    def forward(self, seen):
        return F.leaky_relu(self.usual(self.over(F.pad(seen, self.edges))), LEAK)

    def take(self, numbers):
        """Weights and offsets as they were written, without a normalisation yet."""
        rows, columns, channels, to = (self.over.weight.shape[k] for k in (2, 3, 1, 0))
        self.over.weight.data = numbers(rows, columns, channels, to).permute(3, 2, 0, 1).contiguous()
        self.over.bias.data = numbers(to)

    def normalise(self, results):
        """Makes what a batch's results are on average its normalisation, which changes nothing but how it learns on."""
        variance, mean = torch.var_mean(results, (0, 2, 3))
        self.usual.running_mean, self.usual.running_var = mean, variance
        self.usual.weight.data, self.usual.bias.data = torch.sqrt(variance + self.usual.eps), mean.clone()

    def numbers(self):
        """Weights and offsets; normalisation becomes part of them."""
        factor = self.usual.weight / torch.sqrt(self.usual.running_var + self.usual.eps)
        yield (self.over.weight * factor[:, None, None, None]).permute(2, 3, 1, 0)
        yield (self.over.bias - self.usual.running_mean) * factor + self.usual.bias


def dense(channels, last, results, begins):
    """Two layers that see all values at once; results begin at a share of what chance would make them."""
    layers = nn.Sequential(nn.Linear(channels, last), nn.LeakyReLU(LEAK), nn.Linear(last, results))
    for layer in (layers[0], layers[2]):
        nn.init.kaiming_normal_(layer.weight, LEAK)
        nn.init.zeros_(layer.bias)
    layers[2].weight.data *= begins
    return layers


def numbers_of(layers):
    for layer in (layers[0], layers[2]):
        yield layer.weight.T
        yield layer.bias


def take_dense(layers, numbers):
    for layer in (layers[0], layers[2]):
        layer.weight.data = numbers(*reversed(layer.weight.shape)).T.contiguous()
        layer.bias.data = numbers(*layer.bias.shape)


@torch.no_grad()
def begun(network, begin, *seen):
    """A network by chance, or with the weights of a file, whose layers are normalised by what it makes of a batch."""
    if begin:
        rest = torch.from_numpy(np.fromfile(begin, "<f4"))

        def numbers(*shape):
            nonlocal rest
            size = int(np.prod(shape))
            first, rest = rest[:size].reshape(shape), rest[size:]
            return first

        for layer in network.convolutions:
            layer.take(numbers)
            layer.usual.weight.data = torch.sqrt(layer.usual.running_var + layer.usual.eps)
        for layers in network.heads():
            take_dense(layers, numbers)
        network.eval()
        results = {}
        hooks = [layer.over.register_forward_hook(lambda at, _, result: results.update({at: result})) for layer in network.convolutions]
        network(*seen)
        for layer, hook in zip(network.convolutions, hooks):
            hook.remove()
            layer.normalise(results[layer.over])
        network.train()
    return network.to(memory_format=torch.channels_last)


def write(network, out, begin, keep):
    """Little-endian f32, layer by layer: what was learnt, and of the weights that it began with the share that is kept."""
    numbers = [part for layer in network.convolutions for part in layer.numbers()]
    numbers += [part for layers in network.heads() for part in numbers_of(layers)]
    learnt = np.concatenate([np.asarray(part.detach(), "<f4").ravel() for part in numbers])
    before = np.fromfile(begin, "<f4") if keep else 0
    ((1 - keep) * learnt + keep * before).astype("<f4").tofile(out)


def descend(network, steps, most, loss_of, tell_held):
    """So many steps of AdamW, of which the largest is `most`, down the losses that are asked for; told every thousand steps."""
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=1e-2)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, most, total_steps=steps, pct_start=0.08)
    fast, losses = torch.compile(network), []
    for step in range(1, steps + 1):
        loss = loss_of(fast)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        rate.step()
        losses.append(loss.item())
        if step % 1000 == 0 or step == steps:
            print(f"step {step} of {steps}: loss {np.mean(losses[-1000:]):.4f}", flush=True)
            tell_held()


def counts_of_defects(defect):
    """What suspects of damage count: every defect by the root of its suspects."""
    _, each, of_each = np.unique(defect, return_inverse=True, return_counts=True)
    return torch.from_numpy(1 / np.sqrt(of_each[each]))


def tell(name, odds, defect, kind, kinds):
    """How much of the damage is over what 1 and .1 % of the rest reach; by kind for the latter."""
    over = [np.quantile(odds[defect < 0], 1 - false) for false in (0.01, 0.001)]
    shares = [100 * (odds[defect >= 0] > most).mean() for most in over]
    of_kinds = [f"{name} {100 * (odds[kind == k] > over[1]).mean():.0f}" for k, name in enumerate(kinds)]
    print(f"  {name}: {shares[0]:.1f}, {shares[1]:.1f} % of the damage over 1, 0.1 % of the rest ({', '.join(of_kinds)})", flush=True)
