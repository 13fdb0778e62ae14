# docker build --tag selftouch .
# docker run --rm --volume "$PWD/runs:/selftouch/runs" selftouch
# Another command: docker run --rm --volume "$PWD/runs:/selftouch/runs" selftouch selftouch run torus
FROM python:3.12-slim-bookworm

# Drake needs glib from the system.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libglib2.0-0 make \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /selftouch
COPY . .
RUN make install PYTHON=python3
ENV PATH="/selftouch/.venv/bin:$PATH"
CMD ["make", "demo"]
