// The device's network settings as a file for systemd-networkd.
#pragma once

#include <string>

#include "firmware/settings/settings.h"

namespace finsight {

/// The settings as a .network file of systemd-networkd, for every Ethernet port.
std::string networkd_file(const NetworkSettings& settings);

}  // namespace finsight
