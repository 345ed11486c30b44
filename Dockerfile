# pga_me_ros on Ubuntu 24.04 with ROS 2 Jazzy. UNTESTED: it follows README's "Ubuntu 24.04 + Jazzy", but was never built.
#   docker build -t pga_me_ros .
#   docker run --rm -v "$PWD/runs:/workspace/runs" pga_me_ros \
#       ros2 run pga_me_ros orchestrator --ros-args --params-file config/qd_hopper.yaml -p evaluations:=2000
FROM ros:jazzy-ros-base

RUN apt-get update && apt-get install -y --no-install-recommends \
        g++ python3-dev python3-venv python3-colcon-common-extensions python3-rosdep \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /workspace
# PyBullet has no wheel for Python 3.12; it is compiled in a layer of its own, with NumPy present.
RUN apt-get update && apt-get install -y --no-install-recommends python3-numpy && rm -rf /var/lib/apt/lists/* \
    && python3 -m venv --system-site-packages /venv \
    && /venv/bin/pip install --no-cache-dir wheel torch \
    && /venv/bin/pip install --no-cache-dir --no-build-isolation pybullet==3.2.7

COPY . .
RUN apt-get update && rosdep update \
    && rosdep install --from-paths . msg_defs --ignore-src -y \
        --skip-keys "python3-torch python3-pybullet-pip python3-ruff-pip" \
    && rm -rf /var/lib/apt/lists/*
RUN . /venv/bin/activate && . /opt/ros/jazzy/setup.sh && colcon build --base-paths . msg_defs

ENV PATH=/venv/bin:$PATH
RUN printf '#!/bin/bash\nset -e\n. /opt/ros/jazzy/setup.bash\n. /workspace/install/setup.bash\nexec "$@"\n' > /entrypoint \
    && chmod +x /entrypoint
ENTRYPOINT ["/entrypoint"]
CMD ["bash"]
