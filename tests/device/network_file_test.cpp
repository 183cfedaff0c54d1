#include "firmware/device/network_file.h"

#include <doctest/doctest.h>

using namespace finsight;

TEST_CASE("network file: asks a DHCP server, or has the address and the gateway") {
  CHECK(networkd_file({}).find("DHCP=ipv4\n") != std::string::npos);
  CHECK(networkd_file({}).find("LinkLocalAddressing=ipv4\n") != std::string::npos);
  const std::string fixed = networkd_file({"192.168.0.40/24", "192.168.0.1"});
  CHECK(fixed.find("Address=192.168.0.40/24\nGateway=192.168.0.1\n") != std::string::npos);
  CHECK(fixed.find("DHCP") == std::string::npos);
  CHECK(networkd_file({"192.168.0.40/24", ""}).find("Gateway") == std::string::npos);
}
