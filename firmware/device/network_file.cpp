#include "firmware/device/network_file.h"

namespace finsight {

std::string networkd_file(const NetworkSettings& settings) {
  std::string text = "[Match]\nType=ether\n[Network]\nLinkLocalAddressing=ipv4\nIPv6AcceptRA=no\n";
  if (settings.address.empty()) {
    text += "DHCP=ipv4\n[DHCPv4]\nUseDNS=no\nUseNTP=no\nUseHostname=no\n";
  } else {
    text += "Address=" + settings.address + "\n";
    if (!settings.gateway.empty()) text += "Gateway=" + settings.gateway + "\n";
  }
  return text;
}

}  // namespace finsight
