# The package as the README installs it; the engine is built as it is installed, by the compiler of the base image.
#   docker build -t eppanalysis .
#   docker run --rm -v "$PWD":/work eppanalysis validate my_loop.toml -o my_loop.png
FROM python:3.12
WORKDIR /eppanalysis
COPY . .
RUN python3 -m venv .venv && .venv/bin/pip install -e . && .venv/bin/eppanalysis validate fig8a_original -o fig8a_original.png
WORKDIR /work
ENTRYPOINT ["/eppanalysis/.venv/bin/eppanalysis"]
CMD ["--help"]
