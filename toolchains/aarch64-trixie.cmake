# For the board: 64-bit ARM, Debian 13. ctest runs the programs in qemu-user.
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(FINSIGHT_DEBIAN_ARCH arm64)
set(FINSIGHT_TRIPLE aarch64-linux-gnu)
include(${CMAKE_CURRENT_LIST_DIR}/trixie.cmake)
# Here and not in the preset, where CMAKE_CXX_FLAGS would replace trixie.cmake's flags.
string(APPEND CMAKE_CXX_FLAGS_INIT " -mtune=cortex-a72")
find_program(FINSIGHT_QEMU NAMES qemu-aarch64-static qemu-aarch64)
# qemu's default processor emulates pointer authentication, which makes everything nearly four times slower.
set(CMAKE_CROSSCOMPILING_EMULATOR "${FINSIGHT_QEMU};-cpu;cortex-a72;-L;${CMAKE_SYSROOT}")
