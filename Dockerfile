# SafeStage. Traces and rules are in the folder that is mounted:
#
#   docker build -t safestage .
#   docker run --rm -v "$PWD:/data" safestage score traces/ --rules fsh

FROM python:3.12-slim AS wheel
WORKDIR /src
COPY . .
RUN python -m pip wheel --no-deps --wheel-dir /dist .

FROM python:3.12-slim
COPY --from=wheel /dist /dist
RUN python -m pip install --no-cache-dir "$(ls /dist/*.whl)[import,plot]" && rm -r /dist
WORKDIR /data
ENTRYPOINT ["safestage"]
CMD ["--help"]
