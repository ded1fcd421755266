# docker build -t hopdata . && docker run --rm -v "$PWD:/study" hopdata run config/monday.yaml
# Installs the versions in requirements.lock. A running container fetches nothing.
# The base is named by its digest (all platforms); the tag is for the reader.
FROM python:3.13.15-slim-trixie@sha256:7c61056e61ac89e852de05f3dc6fa51a6dd2181797bceed46aa725dd7cb2cd3b
WORKDIR /build
COPY requirements.lock requirements-build.lock ./
RUN pip install --no-cache-dir --require-hashes --only-binary :all: -r requirements-build.lock \
 && pip install --no-cache-dir --require-hashes --no-build-isolation -r requirements.lock
COPY . .
RUN pip install --no-cache-dir --no-build-isolation --no-deps . && rm -r /build
# Machine code is compiled once, here, by the sample's study (which also tests the image) and by the calls that
# load the integrator. The user who runs the image may have no home folder, and Numba looks for machine code only
# in a folder that this user can write to.
ENV NUMBA_CACHE_DIR=/opt/hopdata-code MPLCONFIGDIR=/tmp/matplotlib XDG_CACHE_HOME=/tmp/cache
WORKDIR /trial
RUN hopdata run --cores 2 && rm -rf /trial/* /tmp/cache
RUN python -c "from hopdata.hybrid.driver import loop; from hopdata.hybrid.methods import table; loop.compiled_run(), loop.compiled_first_order(), [*map(table.generic_code, table.TABLEAUS)]" \
 && chmod -R a+rwX "$NUMBA_CACHE_DIR"
WORKDIR /study
ENTRYPOINT ["hopdata"]
CMD ["--help"]
