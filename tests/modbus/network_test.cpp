#include "firmware/modbus/network.h"

#include <doctest/doctest.h>

#include <string>

using namespace finsight;

TEST_CASE("network: an address is dotted decimal, with or without its prefix length") {
  CHECK(is_ipv4("192.168.0.40/24", true));
  CHECK(is_ipv4("10.0.0.1", false));
  for (const char* wrong : {"192.168.0.40", "192.168.0.40/", "192.168.0.40/0", "192.168.0.40/33", "192.168.0.40/24x",
                            "192.168.0/24", "256.0.0.1/8", "/24", "a.b.c.d/24", "1.2.3.4/24\nGateway=6.6.6.6"}) {
    CAPTURE(wrong);
    CHECK_FALSE(is_ipv4(wrong, true));
  }
  CHECK_FALSE(is_ipv4(std::string("10.0.0.1\0\nDHCP=yes", 18), false));
  CHECK_FALSE(is_ipv4("10.0.0.1/8", false));
  CHECK_FALSE(is_ipv4("", false));
}
