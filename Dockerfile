# affmap on a CPU (x86-64), nothing compiled:
#   docker build --tag affmap .
#   docker run --rm --volume "$PWD/runs:/data/runs" affmap affmap experiment=exp1 scale=smoke
# torch comes with CUDA (several GB) unless --build-arg PIP_EXTRA_INDEX_URL=... points pip to PyTorch's CPU index.
FROM python:3.13-slim

ARG PIP_EXTRA_INDEX_URL
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore

WORKDIR /src
COPY constraints.txt ./
ENV PIP_CONSTRAINT=/src/constraints.txt PIP_BUILD_CONSTRAINT=/src/constraints.txt

# First and by itself: it changes rarely, and is most of the image.
RUN python -m pip install torch

COPY pyproject.toml README.md LICENSE CITATION.cff ./
COPY affmap affmap
COPY conf conf
COPY hydra_plugins hydra_plugins
COPY runs/reference runs/reference
RUN python -m pip install .

WORKDIR /data
CMD ["affmap", "--help"]
