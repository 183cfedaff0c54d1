// The block that gathers all fingers as a PLC's source code: FB_FinsightGripper and its like in SCL.
#include <array>
#include <sstream>

#include "hostgen/plc/dialect.h"
#include "hostgen/plc/plc_files.h"

namespace finsight::host {

namespace {

/// `words` begin with the block; all values are the block's own variables.
Dialect of_gripper(Dialect dialect) {
  dialect.target = dialect.local;
  dialect.first = kGatheredAddress;
  return dialect;
}

/// The finger that a row belongs to, from 1; 0: the gripper.
int finger_of(const RegisterRow& row) {
  const int at = row.address - address_of("finger_1_status");
  return at < 0 ? 0 : 1 + at / kFingerStride;
}

/// The variable that says whether the row's values may be used.
std::string alive_of(const Dialect& dialect, int finger) {
  return dialect.local + (finger == 0 ? "alive" : "finger_" + std::to_string(finger) + "_alive");
}

/// Register `row` of finger 1, of this finger.
std::string finger_word(const Dialect& dialect, const RegisterRow& row, int finger) {
  return word(dialect, row.address + (finger - 1) * kFingerStride);
}

std::string last_heartbeat(const Dialect& dialect, int finger) {
  return std::string(dialect.local) + "last_heartbeat_" + std::to_string(finger);
}

std::string commented(const Dialect& dialect, const std::string& what) {
  return std::string("  ") + dialect.comment_begin + what + dialect.comment_end + "\n";
}

std::string outputs(const RegisterTable& table, const Dialect& dialect) {
  std::string text = "  alive : BOOL;" + commented(dialect, "of all fingers; while FALSE, use no value of the gripper");
  for (int finger = 1; finger <= kMostFingers; ++finger) {
    text += "  finger_" + std::to_string(finger) + "_alive : BOOL;" +
            commented(dialect, "its results keep coming; while FALSE, use none of its values");
  }
  for (const RegisterRow& row : table.gathered) {
    if (is_reserved(row)) continue;
    const std::string at = "register " + std::to_string(row.address);
    if (is_bits(row)) {
      for (const NamedValue& bit : row.values) {
        text +=
            "  " + variable_of(row, bit) + " : BOOL;" + commented(dialect, at + ", bit " + std::to_string(bit.value));
      }
      continue;
    }
    text +=
        "  " + variable_of(row) + " : " + type_of(row) + ";" + commented(dialect, at + ": " + full_description(row));
    if (row.may_be_invalid()) text += std::string("  ") + row.name + "_valid : BOOL;\n";
  }
  return text;
}

/// A link that stands repeats all heartbeats; a finger that stands grows old.
std::string alive_checks(const Dialect& dialect) {
  const std::string local = dialect.local, period = local + "poll_period";
  std::string same, kept, all = local + "finger_1_alive", each;
  for (int finger = 1; finger <= kMostFingers; ++finger) {
    const std::string n = std::to_string(finger);
    const std::string heartbeat = finger_word(dialect, row_named("finger_1_heartbeat"), finger);
    if (finger > 1) same += " AND ";
    same += "(" + heartbeat + " = " + last_heartbeat(dialect, finger) + ")";
    kept += "  " + last_heartbeat(dialect, finger) + " := " + heartbeat + ";\n";
    each += "  " + local + "finger_" + n + "_alive := NOT " + local + "quiet.Q AND (" + local + "fingers >= " + n +
            ")\n    AND (WORD_TO_UINT(" + finger_word(dialect, row_named("finger_1_age"), finger) + ") <= " + local +
            "max_age) AND (WORD_TO_UINT(" + finger_word(dialect, row_named("finger_1_fault"), finger) + ") <> " +
            std::to_string(value_named("fault", "stalled")) + ");\n";
    if (finger > 1) all += " AND ((" + local + "fingers < " + n + ") OR " + local + "finger_" + n + "_alive)";
  }
  return "  " + local + "quiet(IN := " + same + ",\n    PT := " + period + " + " + period + " + T#200ms);\n" + kept +
         each + "  " + local + "alive := " + all + ";\n";
}

std::string gripper_assignments(const RegisterTable& table, const Dialect& dialect) {
  std::ostringstream text;
  for (const RegisterRow& row : table.gathered) {
    if (is_reserved(row)) continue;
    const std::string alive = alive_of(dialect, finger_of(row));
    if (is_bits(row)) {
      for (const NamedValue& bit : row.values) {
        text << "  " << dialect.local << variable_of(row, bit) << " := " << alive << " AND (("
             << word(dialect, row.address) << " AND WORD#" << hexadecimal(1U << bit.value) << ") <> WORD#16#0);\n";
      }
      continue;
    }
    const std::string variable = dialect.local + variable_of(row), value = converted(dialect, row);
    if (!row.may_be_invalid()) {
      if (row.address != address_of("fingers")) text << "  " << variable << " := " << value << ";\n";
      continue;
    }
    const std::string valid = std::string(dialect.local) + row.name + "_valid";
    text << "  " << valid << " := " << alive << " AND (" << validity(dialect, row) << ");\n  IF " << valid << " THEN "
         << variable << " := " << value << "; ELSE " << variable << " := " << (type_of(row) == "REAL" ? "0.0" : "0")
         << "; END_IF;\n";
  }
  const std::string local = dialect.local;
  text << "  IF NOT " << local << "alive THEN " << local << "gripper_state_any_fault := TRUE; END_IF;\n";
  for (int finger = 1; finger <= kMostFingers; ++finger) {
    const std::string name = local + "finger_" + std::to_string(finger);
    text << "  IF NOT " << name << "_alive AND (" << local << "fingers >= " << finger << ") THEN " << name
         << "_status_any_fault := TRUE; END_IF;\n";
  }
  return text.str();
}

std::string inputs(const Dialect& dialect) {
  return "  poll_period : TIME := T#100ms;" +
         commented(
             dialect,
             "how often the words are read; without any new heartbeat for twice as long and 200 ms, none is alive") +
         "  max_age : UINT := 3000;" +
         commented(dialect, "0.1 ms; results that were older than this when they were read are not used");
}

std::string memory() {
  std::string text;
  for (int finger = 1; finger <= kMostFingers; ++finger) {
    text += "  " + last_heartbeat(kStructuredText, finger) + " : WORD;\n";
  }
  return text;
}

std::string body(const RegisterTable& table, const Dialect& dialect) {
  const RegisterRow& fingers = row_named("fingers");
  return "  " + std::string(dialect.local) + "fingers := " + converted(dialect, fingers) + ";\n" +
         alive_checks(dialect) + gripper_assignments(table, dialect) + "END_FUNCTION_BLOCK\n";
}

}  // namespace

std::string gripper_structured_text(const RegisterTable& table) {
  const Dialect st = of_gripper(kStructuredText);
  return "\n(* A device with several fingers: read registers 2000 to " +
         std::to_string(kGatheredAddress + kGatheredRegisters - 1) +
         " under any of its unit ids into a variable of type\n   FinsightGripperWords; one read has all fingers at one "
         "moment. While a finger is not alive, none of its values is\n   valid, and none of the gripper's. *)\n"
         "FUNCTION_BLOCK FB_FinsightGripper\nVAR_INPUT\n  words : FinsightGripperWords;\n" +
         inputs(st) + "END_VAR\nVAR_OUTPUT\n" + outputs(table, st) + "END_VAR\nVAR\n" + memory() +
         "  quiet : TON;\nEND_VAR\n" + body(table, st);
}

std::string gripper_scl(const RegisterTable& table) {
  const Dialect scl = of_gripper(kScl);
  return "\n// A device with several fingers: let MB_CLIENT read registers 2000 to " +
         std::to_string(kGatheredAddress + kGatheredRegisters - 1) + " (MB_DATA_ADDR 42001, MB_DATA_LEN " +
         std::to_string(kGatheredRegisters) +
         ") under\n// any of its unit ids; one read has all fingers at one moment.\n"
         "FUNCTION_BLOCK \"Finsight_Gripper\"\n{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\nVAR_INPUT\n" +
         inputs(scl) + "END_VAR\nVAR_OUTPUT\n" + outputs(table, scl) + "END_VAR\nVAR_IN_OUT\n  words : Array[0.." +
         std::to_string(kGatheredRegisters - 1) + "] of Word;\nEND_VAR\nVAR\n" + memory() +
         "  quiet {InstructionName := 'TON_TIME'; LibVersion := '1.0'} : TON_TIME;\nEND_VAR\nBEGIN\n" +
         body(table, scl);
}

}  // namespace finsight::host
