# sim2vr in a container: everything compiled and installed, without a display or a GPU.
#
#   docker build -t sim2vr .
#   docker run --rm -v "$PWD/out:/out" sim2vr           # a pretrained user plays one round; film in out/
#   docker run --rm -it sim2vr bash                     # the command line, in /opt/sim2vr
FROM debian:12-slim

RUN apt-get update \
 && apt-get install -y --no-install-recommends ca-certificates git make \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/sim2vr
COPY . .
RUN make setup && rm -rf /var/lib/apt/lists/* ~/.cache
ENV PATH=/opt/sim2vr/.venv/bin:$PATH
# A build whose smoke test fails makes no image.
RUN sim2vr-harness evaluate --user random --set env.app.game=sample --episodes 1 --set env.max_episode_seconds=2 --out /tmp/smoke
CMD ["sim2vr-harness", "evaluate", "pretrained:whacamole_constrained", "--condition", "medium", "--episodes", "1", "--record", "--out", "/out"]
