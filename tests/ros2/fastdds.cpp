// A node of another DDS implementation (eProsima Fast DDS, of which ROS 2's default middleware is
// made), with types written out by hand over its own CDR library.
//
//   fastdds DOMAIN listen TOPIC NoiseLevel|DiagnosticArray   prints a JSON object a message
//   fastdds DOMAIN inject TOPIC                              sends requests that are no requests,
//                                                            then one that is: snr at 60 %
//
// Runs until its standard input closes. Joins the domain as with ROS_LOCALHOST_ONLY.

#include <chrono>
#include <cstdio>
#include <cstring>
#include <functional>
#include <iomanip>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

using Bytes = std::vector<char>;

// Carries serialised messages as they are, encapsulation included.
class RawType : public TopicDataType
{
public:
    explicit RawType(const std::string& name)
    {
        setName(name.c_str());
        m_typeSize = 1 << 16;
        m_isGetKeyDefined = false;
    }

    bool serialize(void* data, SerializedPayload_t* payload) override
    {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        payload->encapsulation = CDR_LE;
        payload->length = static_cast<uint32_t>(bytes.size());
        std::memcpy(payload->data, bytes.data(), bytes.size());
        return true;
    }

    bool deserialize(SerializedPayload_t* payload, void* data) override
    {
        const char* first = reinterpret_cast<const char*>(payload->data);
        static_cast<Bytes*>(data)->assign(first, first + payload->length);
        return true;
    }

    std::function<uint32_t()> getSerializedSizeProvider(void* data) override
    {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }

    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

// Reads a message field by field and writes it as JSON.
class Reader
{
public:
    explicit Reader(Bytes& bytes)
        : buffer_(bytes.data(), bytes.size()), cdr_(buffer_, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR)
    {
        cdr_.read_encapsulation();
        out_.precision(17);
    }

    template <typename T> T value()
    {
        T read{};
        cdr_ >> read;
        return read;
    }

    template <typename T> void number(const char* name) { key(name) << +value<T>(); }
    void text(const char* name) { key(name) << std::quoted(value<std::string>()); }

    void doubles(const char* name, size_t count)
    {
        key(name) << '[';
        for (size_t i = 0; i < count; ++i)
            out_ << (i ? "," : "") << value<double>();
        out_ << ']';
    }

    void doubles(const char* name) { doubles(name, value<uint32_t>()); }

    void texts(const char* name)
    {
        key(name) << '[';
        for (uint32_t count = value<uint32_t>(), i = 0; i < count; ++i)
            out_ << (i ? "," : "") << std::quoted(value<std::string>());
        out_ << ']';
    }

    template <typename Body> void object(const char* name, Body body)
    {
        key(name);
        nested(body);
    }

    template <typename Body> void objects(const char* name, Body body)
    {
        key(name) << '[';
        for (uint32_t count = value<uint32_t>(), i = 0; i < count; ++i)
        {
            out_ << (i ? "," : "");
            nested(body);
        }
        out_ << ']';
    }

    std::string json() const { return "{" + out_.str() + "}"; }

private:
    std::ostream& key(const char* name)
    {
        out_ << (first_ ? "\"" : ",\"") << name << "\":";
        first_ = false;
        return out_;
    }

    template <typename Body> void nested(Body body)
    {
        out_ << '{';
        first_ = true;
        body();
        first_ = false;
        out_ << '}';
    }

    FastBuffer buffer_;
    Cdr cdr_;
    std::ostringstream out_;
    bool first_ = true;
};

void read_header(Reader& read)
{
    read.object("header", [&] {
        read.object("stamp", [&] {
            read.number<int32_t>("sec");
            read.number<uint32_t>("nanosec");
        });
        read.text("frame_id");
    });
}

std::string noise_level(Bytes& bytes)
{
    Reader read(bytes);
    read_header(read);
    read.number<uint64_t>("sequence");
    read.number<uint64_t>("dropped");
    read.number<int64_t>("latency_ns");
    read.number<double>("level");
    read.number<double>("std_dev");
    read.doubles("probabilities", 11);
    read.number<double>("raw");
    read.number<double>("effort");
    read.text("kind");
    read.texts("kinds");
    read.doubles("kind_probabilities");
    read.texts("injected_kinds");
    read.doubles("injected_levels");
    read.texts("injected_drawn");
    return read.json();
}

std::string diagnostic_array(Bytes& bytes)
{
    Reader read(bytes);
    read_header(read);
    read.objects("status", [&] {
        read.number<uint8_t>("level");
        read.text("name");
        read.text("message");
        read.text("hardware_id");
        read.objects("values", [&] {
            read.text("key");
            read.text("value");
        });
    });
    return read.json();
}

struct Printer : DataReaderListener
{
    std::string (*decode)(Bytes&);

    void on_data_available(DataReader* reader) override
    {
        Bytes bytes;
        SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
            if (info.valid_data)
                std::printf("%s\n", decode(bytes).c_str());
        std::fflush(stdout);
    }
};

DomainParticipant* join(int domain)
{
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    return DomainParticipantFactory::get_instance()->create_participant(domain, qos);
}

Topic* topic_of(DomainParticipant* participant, const std::string& name, const std::string& type)
{
    TypeSupport support(new RawType(type));
    support.register_type(participant);
    return participant->create_topic("rt" + name, type, TOPIC_QOS_DEFAULT);
}

void wait_for_end()
{
    while (std::getchar() != EOF)
    {
    }
}

void listen(DomainParticipant* participant, const std::string& name, const std::string& type)
{
    const bool levels = type == "NoiseLevel";
    const std::string package = levels ? "murk_msgs" : "diagnostic_msgs";
    Topic* topic = topic_of(participant, name, package + "::msg::dds_::" + type + "_");
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    if (levels)
        qos.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
    qos.history().kind = KEEP_ALL_HISTORY_QOS;
    static Printer printer;
    printer.decode = levels ? noise_level : diagnostic_array;
    Subscriber* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    subscriber->create_datareader(topic, qos, &printer);
    wait_for_end();
}

// A little-endian murk_msgs/Injection.
Bytes injection(const std::string& kind, double level)
{
    Bytes bytes(256);
    FastBuffer buffer(bytes.data(), bytes.size());
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    cdr << kind << level << false;
    bytes.resize(cdr.getSerializedDataLength());
    return bytes;
}

void inject(DomainParticipant* participant, const std::string& name)
{
    Topic* topic = topic_of(participant, name, "murk_msgs::msg::dds_::Injection_");
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    Publisher* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    DataWriter* writer = publisher->create_datawriter(topic, qos);
    PublicationMatchedStatus status;
    do
    {
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
        writer->get_publication_matched_status(status);
    } while (status.current_count == 0);
    const Bytes good = injection("snr", 60.0);
    for (size_t length = 4; length < good.size(); ++length)
    {
        Bytes cut(good.begin(), good.begin() + length);
        writer->write(&cut);
    }
    Bytes endless = good;
    std::memset(endless.data() + 4, 0xff, 4);
    writer->write(&endless);
    for (char fill : {'\x00', '\x7f', '\xff'})
    {
        Bytes noise(200, fill);
        std::memcpy(noise.data(), good.data(), 4);
        writer->write(&noise);
    }
    Bytes request = good;
    writer->write(&request);
    wait_for_end();
}

int main(int argc, char** argv)
{
    DomainParticipant* participant = argc >= 4 ? join(std::atoi(argv[1])) : nullptr;
    if (participant == nullptr)
        return 2;
    std::printf("ready\n");
    std::fflush(stdout);
    if (std::string(argv[2]) == "inject")
        inject(participant, argv[3]);
    else
        listen(participant, argv[3], argv[4]);
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
    return 0;
}
