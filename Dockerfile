# The headless logger: reads the battery, records, serves the pages. See docs/howto/recorder.md.

FROM python:3.11-slim-bookworm AS build
WORKDIR /source
COPY requirements/ requirements/
RUN python -m venv /opt/build && /opt/build/bin/pip install --no-cache-dir --require-hashes -r requirements/build.lock
RUN python -m venv /opt/voltwall && /opt/voltwall/bin/pip install --no-cache-dir --require-hashes -r requirements/run.lock
COPY . .
RUN /opt/build/bin/pip wheel --no-deps --no-build-isolation --wheel-dir /wheels .
RUN /opt/voltwall/bin/pip install --no-deps --no-index /wheels/*.whl

FROM python:3.11-slim-bookworm
RUN useradd --uid 10001 --create-home --groups dialout voltwall && install -d -o voltwall -g voltwall /data /data/tmp
COPY --from=build /opt/voltwall /opt/voltwall
ENV PATH=/opt/voltwall/bin:/usr/local/bin:/usr/bin:/bin
ENV PYTHONUNBUFFERED=1
ENV VOLTWALL_HOST=0.0.0.0
ENV VOLTWALL_PORT=8000
ENV VOLTWALL_DATA=/data
# What is exported or uploaded is made here: the root is read-only in compose.yaml, and /tmp there is memory
ENV TMPDIR=/data/tmp
USER voltwall
WORKDIR /data
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=10s --start-period=30s CMD ["python", "-P", "-m", "voltwall.app.service.health.probe"]
STOPSIGNAL SIGTERM
CMD ["voltwall", "serve"]
