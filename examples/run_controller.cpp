// Runs a controller of the repertoire in plain C++17, from the response of get_behavior alone.
//
//   g++ -std=c++17 -O2 examples/run_controller.cpp -o run_controller
//   ./run_controller response.json < observations.txt > actions.txt
//
// response.json is the response of pga_me_msgs/srv/GetBehavior as JSON, as rosbridge sends it and examples/save_response.py
// saves it. Each line of input has the entries of one observation, in order; joint positions in rad, everything else in the
// units that the message names. Each line of output has the entries of one action. With ROS 2, take the fields of
// pga_me_msgs::msg::Controller instead of the JSON: they have the same names.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

// The part of JSON that messages consist of.
struct Json {
  std::map<std::string, Json> fields;
  std::vector<Json> entries;
  std::string text;  // of a string, a number, true, false or null

  double number() const { return std::stod(text); }
  std::vector<double> numbers() const {
    std::vector<double> all;
    for (const Json& entry : entries) all.push_back(entry.number());
    return all;
  }
  std::vector<std::string> texts() const {
    std::vector<std::string> all;
    for (const Json& entry : entries) all.push_back(entry.text);
    return all;
  }
};

class Parser {
 public:
  explicit Parser(std::string text) : text_(std::move(text)) {}

  Json value() {
    Json json;
    switch (peek()) {
      case '{':
        each('}', [&] {
          std::string name = string();
          expect(':');
          json.fields[name] = value();
        });
        break;
      case '[':
        each(']', [&] { json.entries.push_back(value()); });
        break;
      case '"':
        json.text = string();
        break;
      default:
        while (at_ < text_.size() && std::string(",]} \t\r\n").find(text_[at_]) == std::string::npos) {
          json.text += text_[at_++];
        }
    }
    return json;
  }

 private:
  char peek() {
    at_ = std::min(text_.find_first_not_of(" \t\r\n", at_), text_.size());
    if (at_ == text_.size()) throw std::runtime_error("the JSON ends too early");
    return text_[at_];
  }
  void expect(char wanted) {
    if (peek() != wanted) throw std::runtime_error(std::string("the JSON lacks a ") + wanted);
    ++at_;
  }
  template <typename Function>
  void each(char end, Function read) {
    ++at_;
    while (peek() != end) {
      read();
      if (peek() == ',') ++at_;
    }
    ++at_;
  }
  // Names and units; escapes other than of one character stay as they are.
  std::string string() {
    expect('"');
    std::string out;
    for (; text_.at(at_) != '"'; ++at_) {
      if (text_[at_] == '\\' && text_.at(at_ + 1) != 'u') ++at_;
      out += text_.at(at_);
    }
    ++at_;
    return out;
  }

  std::string text_;
  std::size_t at_ = 0;
};

class Controller {
 public:
  explicit Controller(const Json& message)
      : least_(message.fields.at("observation_low").numbers()),
        most_(message.fields.at("observation_high").numbers()),
        joint_low_(message.fields.at("joint_low").numbers()),
        joint_high_(message.fields.at("joint_high").numbers()),
        parameters_(message.fields.at("parameters").numbers()),
        activations_(message.fields.at("activations").texts()) {
    for (double size : message.fields.at("layer_sizes").numbers()) sizes_.push_back(static_cast<std::size_t>(size));
    const auto names = message.fields.at("observation_names").texts();
    for (const std::string& joint : message.fields.at("joint_names").texts()) {
      const auto found = std::find(names.begin(), names.end(), joint + "/position");
      if (found == names.end()) throw std::runtime_error("no entry has the position of " + joint);
      joints_.push_back(static_cast<std::size_t>(found - names.begin()));
    }
    std::size_t expected = 0;
    for (std::size_t i = 1; i < sizes_.size(); ++i) expected += sizes_[i] * (sizes_[i - 1] + 1);
    if (expected != parameters_.size()) throw std::runtime_error("parameters do not fit layer_sizes");
  }

  // Action for what was measured.
  std::vector<double> act(std::vector<double> x) const {
    if (x.size() != sizes_[0]) throw std::runtime_error("expected " + std::to_string(sizes_[0]) + " numbers");
    // What the network sees: joints from -1 at the lower limit to +1 at the upper one, every entry within its limits.
    for (std::size_t j = 0; j < joints_.size(); ++j) {
      double& entry = x[joints_[j]];
      entry = 2 * (entry - joint_low_[j]) / (joint_high_[j] - joint_low_[j]) - 1;
    }
    for (std::size_t i = 0; i < least_.size(); ++i) x[i] = std::min(std::max(x[i], least_[i]), most_[i]);
    // Each layer is (out, in) weights row by row, then (out) biases.
    const double* next = parameters_.data();
    for (std::size_t layer = 1; layer < sizes_.size(); ++layer) {
      const std::size_t inputs = sizes_[layer - 1], outputs = sizes_[layer];
      const double* bias = next + outputs * inputs;
      std::vector<double> out(bias, bias + outputs);
      for (double& sum : out) {
        for (double entry : x) sum += *next++ * entry;
        sum = activations_[layer - 1] == "relu" ? std::max(sum, 0.0) : std::tanh(sum);
      }
      next += outputs;
      x = std::move(out);
    }
    return x;
  }

 private:
  std::vector<double> least_, most_, joint_low_, joint_high_, parameters_;
  std::vector<std::string> activations_;
  std::vector<std::size_t> sizes_, joints_;
};

int main(int count, char** words) try {
  if (count != 2) throw std::runtime_error("give the file of the response");
  std::ifstream file(words[1]);
  const Json response = Parser({std::istreambuf_iterator<char>(file), {}}).value();
  if (response.fields.at("found").text != "true") throw std::runtime_error(response.fields.at("message").text);
  const Controller controller(response.fields.at("controller"));
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream numbers(line);
    const std::vector<double> measured{std::istream_iterator<double>(numbers), {}};
    if (measured.empty()) continue;
    for (double entry : controller.act(measured)) std::printf("%.9g ", entry);
    std::printf("\n");
  }
  return EXIT_SUCCESS;
} catch (const std::exception& error) {
  std::cerr << "error: " << error.what() << "\n";
  return EXIT_FAILURE;
}
