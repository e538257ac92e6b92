"""One thread: the tests' tensors are small, and two threads on busy cores are many times slower than one."""

import torch

torch.set_num_threads(1)
