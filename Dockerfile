# SafeStage with its numerical kernels compiled. Traces and rules are in the folder that is mounted:
#
#   docker build -t safestage .
#   docker run --rm -v "$PWD:/data" safestage score traces/ --rules fsh

FROM python:3.12-slim AS wheel
WORKDIR /src
COPY . .
RUN python -m pip wheel --no-deps --wheel-dir /dist .

FROM python:3.12-slim
# Machine code for any processor of this architecture, and a folder that every user can read it from.
ENV NUMBA_CPU_NAME=generic \
    NUMBA_CPU_FEATURES="" \
    NUMBA_CACHE_DIR=/usr/local/share/safestage/kernels
COPY --from=wheel /dist /dist
RUN python -m pip install --no-cache-dir "$(ls /dist/*.whl)[import,plot]" && rm -r /dist
RUN python -c "from safestage_eval._process.precompile import compile_kernels, is_compiled; compile_kernels(); raise SystemExit(not is_compiled())"
WORKDIR /data
ENTRYPOINT ["safestage"]
CMD ["--help"]
