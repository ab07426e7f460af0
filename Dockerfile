# The package as the README installs it; the engine is built as it is installed.
#   docker build -t eppanalysis .
#   docker run --rm -v "$PWD":/work eppanalysis validate my_loop.toml -o my_loop.png
FROM python:3.12-slim
WORKDIR /eppanalysis
COPY . .
RUN apt-get update && apt-get install -y --no-install-recommends g++ && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv .venv && .venv/bin/pip install -e . && .venv/bin/eppanalysis validate fig8a_original -o fig8a_original.png
WORKDIR /work
ENTRYPOINT ["/eppanalysis/.venv/bin/eppanalysis"]
CMD ["--help"]
