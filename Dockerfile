# omnilab with all of its plugins, for CPUs; docs/installing.md says how to run it.
FROM python:3.11.13-slim-bookworm AS build
RUN pip install --no-cache-dir uv==0.13.9
ENV UV_PROJECT_ENVIRONMENT=/opt/omnilab UV_PYTHON_DOWNLOADS=never UV_LINK_MODE=copy UV_COMPILE_BYTECODE=1
WORKDIR /source
COPY . .
RUN uv sync --frozen --no-dev --no-editable --extra all

FROM python:3.11.13-slim-bookworm
COPY --from=build /opt/omnilab /opt/omnilab
ENV PATH=/opt/omnilab/bin:$PATH
RUN useradd --uid 1000 --create-home omnilab && install --directory --owner=omnilab /work /work/logs
USER 1000
WORKDIR /work
VOLUME /work/logs
# no port: `serve` listens inside alone until --host and a published port say otherwise
ENTRYPOINT ["omnilab"]
CMD ["--help"]
