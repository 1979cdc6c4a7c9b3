// As much of the ROS 2 package "filters" as exported plugins use; its parameters are a table that the test fills.
#pragma once
#include <map>
#include <string>

namespace filters
{
template <typename T>
class FilterBase
{
public:
    virtual ~FilterBase() = default;
    virtual bool update(const T &in, T &out) = 0;

    bool configure(const std::string &name, const std::map<std::string, std::string> &parameters)
    {
        filter_name_ = name;
        parameters_ = parameters;
        return configure();
    }

protected:
    virtual bool configure() = 0;

    bool getParam(const std::string &name, std::string &value)
    {
        auto found = parameters_.find(name);
        if (found == parameters_.end()) {
            return false;
        }
        value = found->second;
        return true;
    }

    bool getParam(const std::string &name, double &value)
    {
        std::string text;
        if (!getParam(name, text)) {
            return false;
        }
        value = std::stod(text);
        return true;
    }

    bool getParam(const std::string &name, bool &value)
    {
        std::string text;
        if (!getParam(name, text)) {
            return false;
        }
        value = text == "true";
        return true;
    }

    std::string filter_name_;

private:
    std::map<std::string, std::string> parameters_;
};
}  // namespace filters
