# SPDX-License-Identifier: Apache-2.0
# Images with the program, its viewer and the libraries that it needs.
#   docker build --target cpu -t gsapp .
#   docker build --target cuda -t gsapp:cuda .
#   docker build --target packages --output build/packages .     # the .deb and the .tar.gz of a release, for all GPUs
#   docker run --rm --gpus all -v "$PWD:/work" gsapp:cuda train -s builtin:glossy -m output/glossy --eval

FROM node:20-bookworm-slim AS viewer
WORKDIR /gsapp
COPY . .
RUN scripts/build-viewer

FROM debian:12 AS build-cpu
WORKDIR /gsapp
COPY scripts/setup scripts/setup
RUN scripts/setup --no-tests
COPY . .
COPY --from=viewer /gsapp/apps/viewer/dist apps/viewer/dist
RUN cmake --preset release-multi -DGSAPP_CUDA=OFF && cmake --build --preset release-multi
RUN cmake --install build/release-multi --prefix /opt/gsapp && \
    cmake --install build/release-multi --prefix /opt/gsapp --component libraries

FROM nvidia/cuda:12.8.1-devel-ubuntu24.04 AS build-cuda
WORKDIR /gsapp
COPY scripts/setup scripts/setup
RUN scripts/setup --no-tests
COPY . .
COPY --from=viewer /gsapp/apps/viewer/dist apps/viewer/dist
RUN cmake --preset release-multi -DGSAPP_CUDA=ON && cmake --build --preset release-multi
RUN cmake --install build/release-multi --prefix /opt/gsapp && \
    cmake --install build/release-multi --prefix /opt/gsapp --component libraries

# CUDA's compiler does not mind which Linux it runs on; packages are built on the oldest that gsapp supports.
FROM nvidia/cuda:12.8.1-devel-ubuntu24.04 AS toolkit

FROM debian:12 AS build-packages
WORKDIR /gsapp
COPY scripts/setup scripts/setup
RUN scripts/setup --no-tests
COPY --from=toolkit /usr/local/cuda-12.8/bin /usr/local/cuda/bin
COPY --from=toolkit /usr/local/cuda-12.8/nvvm /usr/local/cuda/nvvm
COPY --from=toolkit /usr/local/cuda-12.8/targets/x86_64-linux/include /usr/local/cuda/targets/x86_64-linux/include
COPY --from=toolkit /usr/local/cuda-12.8/targets/x86_64-linux/lib/libcuda* /usr/local/cuda/targets/x86_64-linux/lib/
COPY --from=toolkit /usr/include/nccl.h /usr/local/include/
COPY . .
COPY --from=viewer /gsapp/apps/viewer/dist apps/viewer/dist
RUN cmake --preset release-multi -DGSAPP_CUDA=ON -DCMAKE_CUDA_COMPILER=/usr/local/cuda/bin/nvcc && \
    cmake --build --preset release-multi && cpack --preset release-multi

FROM scratch AS packages
COPY --from=build-packages /gsapp/build/packages/gsapp* /

# The CUDA runtime is part of the program; the driver comes from the host (--gpus all).
FROM ubuntu:24.04 AS cuda
COPY --from=build-cuda /opt/gsapp /opt/gsapp
ENV PATH=/opt/gsapp/bin:$PATH NVIDIA_VISIBLE_DEVICES=all NVIDIA_DRIVER_CAPABILITIES=compute,utility
WORKDIR /work
ENTRYPOINT ["gsapp"]

FROM debian:12-slim AS cpu
COPY --from=build-cpu /opt/gsapp /opt/gsapp
ENV PATH=/opt/gsapp/bin:$PATH
WORKDIR /work
ENTRYPOINT ["gsapp"]
