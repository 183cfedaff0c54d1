# For the workstation, with the board's versions of all libraries: the programs carry the sysroot's dynamic loader and
# library folder, so they run in place, on Debian 12 too. This is how the ports to libcamera and libgpiod are tested
# under sanitizers.
set(CMAKE_SYSTEM_PROCESSOR x86_64)
set(FINSIGHT_DEBIAN_ARCH amd64)
set(FINSIGHT_TRIPLE x86_64-linux-gnu)
include(${CMAKE_CURRENT_LIST_DIR}/trixie.cmake)
# Here and not in the preset, where CMAKE_CXX_FLAGS would replace trixie.cmake's flags.
string(APPEND CMAKE_CXX_FLAGS_INIT " -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer")
string(APPEND CMAKE_EXE_LINKER_FLAGS_INIT
       " -Wl,--dynamic-linker=${CMAKE_SYSROOT}/usr/lib64/ld-linux-x86-64.so.2"
       " -Wl,--disable-new-dtags -Wl,-rpath,${CMAKE_SYSROOT}/usr/lib/${FINSIGHT_TRIPLE}")
