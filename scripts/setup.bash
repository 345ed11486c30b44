# Source this file in bash: activates the environment around it, with pga_me_ros and pga_me_msgs.
# The setup installs it as .venv/setup.bash.
_pga_me_prefix="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"

# Prepends an entry of the environment to a colon-separated variable; sourcing twice changes nothing.
_pga_me_prepend() {
    case ":${!1-}:" in
        *":$2:"*) ;;
        *) export "$1=$2${!1:+:${!1}}" ;;
    esac
}

_pga_me_prepend PATH "$_pga_me_prefix/bin"
_pga_me_prepend AMENT_PREFIX_PATH "$_pga_me_prefix"
_pga_me_prepend CMAKE_PREFIX_PATH "$_pga_me_prefix"
export VIRTUAL_ENV="$_pga_me_prefix"
export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
# The wheels contain only this middleware.
case "${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}" in
    rmw_fastrtps_cpp) ;;
    *) echo "RMW_IMPLEMENTATION was $RMW_IMPLEMENTATION; this environment has rmw_fastrtps_cpp only, and sets that." >&2 ;;
esac
export RMW_IMPLEMENTATION=rmw_fastrtps_cpp
# What colcon must tell CMake so that it can build against the wheels; your own file goes first.
export COLCON_DEFAULTS_FILE="${COLCON_DEFAULTS_FILE:-$_pga_me_prefix/colcon_defaults.yaml}"
unset _pga_me_prefix
unset -f _pga_me_prepend
