# docker build -t quadid-log . && docker run --rm -v "$PWD":/logs quadid-log analyze flight.bin
FROM python:3.12-slim AS build
WORKDIR /source
COPY pyproject.toml hatch_build.py README.md LICENSE ./
COPY quadid_logs quadid_logs
RUN python -m venv /opt/quadid && /opt/quadid/bin/pip install --no-cache-dir .

FROM python:3.12-slim
COPY --from=build /opt/quadid /opt/quadid
RUN useradd --create-home --uid 1000 pilot && mkdir /logs && chown pilot /logs
USER 1000
WORKDIR /logs
ENTRYPOINT ["/opt/quadid/bin/quadid-log"]
