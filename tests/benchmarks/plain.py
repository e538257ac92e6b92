"""One model in PyTorch's own layers, as anybody would write it."""

import lightning
import numpy as np
import torch
from flights import SETTINGS, PlainBatch
from torch import Tensor, nn

from affmap.model.stack import Stack
from affmap.model.vision import sizes


class PlainModel(nn.Module):
    """One member in PyTorch's own layers, as the paper describes it (Appendix A)."""

    def __init__(self, stack: Stack, member: int = 0) -> None:
        """Copy the weights of a member of `stack`."""
        super().__init__()
        settings = stack.settings
        channels, hidden = sizes(settings.context_size)
        self.scale = settings.delta_scale
        self.vision = nn.Sequential(
            nn.Conv2d(stack.num_channels, channels, 3),
            nn.Tanh(),
            nn.MaxPool2d(3, 2),
            nn.Conv2d(channels, 2 * channels, 3),
            nn.Tanh(),
            nn.Flatten(),
            nn.Linear(8 * channels, hidden),
            nn.Tanh(),
            nn.Linear(hidden, settings.context_size),
            nn.Tanh(),
        )
        inputs = 2 + 4 + settings.context_size
        self.hidden = nn.Sequential(nn.Linear(inputs, settings.hidden_size, bias=False), nn.Tanh())
        self.mean = nn.Linear(settings.hidden_size, 2)
        self.log_std = nn.Linear(settings.hidden_size, 2)
        self._copy({name: weight[member] for name, weight in stack.state_dict().items()})

    @torch.no_grad()
    def _copy(self, weights: dict[str, Tensor]) -> None:
        prefixes = ("vision.conv1_", "vision.conv2_", "vision.linear1.", "vision.linear2.", "transition.hidden_")
        layers = [layer for part in (self.vision, self.hidden) for layer in part if hasattr(layer, "weight")]
        for prefix, layer in zip(prefixes, layers, strict=True):
            for key, own in layer.named_parameters():
                weight = weights[prefix + key]
                own.copy_(weight.T if weight.ndim == 2 else weight)
        outputs = (weights["transition.output_weight"].T, weights["transition.output_bias"])
        for kind, part in enumerate((self.mean, self.log_std)):
            for own, weight in zip(part.parameters(), outputs, strict=True):
                own.copy_(weight.chunk(2)[kind])

    def forward(self, batch: PlainBatch) -> Tensor:
        """Mean negative log-likelihood of a batch, nats."""
        code = self.vision(batch.views)
        hidden = self.hidden(torch.cat([self.scale * batch.delta, batch.action, code], dim=1))
        mean, log_std = self.mean(hidden), self.log_std(hidden)
        density = torch.distributions.Normal(mean, log_std.exp(), validate_args=False)
        # In scaled units; the logarithm brings the density of both coordinates back to u/step.
        return -density.log_prob(self.scale * batch.target).sum(1).mean() - 2 * float(np.log(self.scale))

    def optimizer(self) -> torch.optim.Optimizer:
        """Adam with a group for each sub-model."""
        transition = [*self.hidden.parameters(), *self.mean.parameters(), *self.log_std.parameters()]
        groups = [
            {"params": transition, "lr": SETTINGS.transition_lr},
            {"params": list(self.vision.parameters()), "lr": SETTINGS.vision_lr},
        ]
        return torch.optim.Adam(groups, eps=SETTINGS.adam_eps)


class PlainModule(lightning.LightningModule):
    """The plain model in a stock LightningModule."""

    def __init__(self, model: PlainModel) -> None:
        super().__init__()
        self.model = model

    def training_step(self, batch: PlainBatch, batch_index: int) -> Tensor:
        """The loss."""
        return self.model(batch)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """One Adam."""
        return self.model.optimizer()
