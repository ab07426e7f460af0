# The package as the README installs it. The compiler of the base image builds the engine. Its user is nobody, not root:
#   docker build -t eppanalysis .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD":/work eppanalysis validate my_loop.toml -o my_loop.png
FROM python:3.12
WORKDIR /eppanalysis
COPY . .
RUN python3 -m venv .venv && .venv/bin/pip install -e . && .venv/bin/eppanalysis validate fig8a_original -o fig8a_original.png
WORKDIR /work
USER 65534:65534
ENV HOME=/tmp
ENTRYPOINT ["/eppanalysis/.venv/bin/eppanalysis"]
CMD ["--help"]
