# tbmslam without anything else installed:
#   docker build -t tbmslam .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" tbmslam map run.bag -o out/one
# Without --user the maps belong to the first user of the system (1000), and another's folder cannot be written.
FROM python:3.12-slim AS wheel
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.12-slim
ENV NUMBA_CACHE_DIR=/var/cache/tbmslam PYTHONUNBUFFERED=1
COPY --from=wheel /wheels /wheels
RUN pip install --no-cache-dir /wheels/*.whl && rm -r /wheels
# Compiled while the image is built: kernels are cached by content, whoever runs them. A processor unlike the builder's compiles
# them once more.
RUN mkdir -m 777 /var/cache/tbmslam && tbmslam warm-up && chmod -R a+rwX /var/cache/tbmslam
RUN useradd --create-home user
USER user
WORKDIR /data
ENTRYPOINT ["tbmslam"]
CMD ["--help"]
