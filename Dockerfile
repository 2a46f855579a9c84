# hrs-twin as a container: the package in a virtual environment, kernels compiled for the machine beside the first start.
FROM python:3.12-slim AS build
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY station station
COPY theory theory
COPY controllers controllers
COPY api api
COPY benchmarks benchmarks
RUN python -m venv /opt/hrs && /opt/hrs/bin/pip install --no-cache-dir .

FROM python:3.12-slim
RUN useradd --create-home --uid 10001 hrs && mkdir -p /data && chown hrs /data
COPY --from=build /opt/hrs /opt/hrs
USER hrs
ENV PATH=/opt/hrs/bin:$PATH HRS_DATA=/data XDG_CACHE_HOME=/data/cache
EXPOSE 8000
VOLUME /data
STOPSIGNAL SIGTERM
CMD ["hrs", "serve", "--host", "0.0.0.0"]
